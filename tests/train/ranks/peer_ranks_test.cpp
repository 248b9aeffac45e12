// SPDX-License-Identifier: Apache-2.0
// Ranks that talk over sockets end in the bytes of one rank, and in one message where one of them
// fails. Here they are threads with a socket each; tests/cli/ranks_test.cpp has processes.
#include "gs_train/ranks/peer_ranks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <atomic>
#include <thread>

#include "gs_core/error.h"
#include "gs_train/ranks/peer_communicator.h"
#include "gs_train/ranks/ranked_backend.h"
#include "tests/support/error_of.h"
#include "tests/support/scene_run.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr std::size_t kRowsOfChunk = 5;  // so that a few dozen Gaussians lie on all ranks

/// What another rank does.
using Work = std::function<void(PeerSocket& leader, int rank, int count)>;

/// A run's other ranks, each a thread with one end of a socket.
class PeerThreads {
 public:
  PeerThreads(int count, const Work& work) {
    for (int rank = 1; rank < count; ++rank) {
      int ends[2];
      EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, ends), 0);
      peers_.emplace_back(Descriptor(ends[0]));
      threads_.emplace_back([=, end = ends[1]] {
        PeerSocket leader{Descriptor(end)};
        try {
          work(leader, rank, count);
        } catch (const PeerLost&) {
        } catch (const Error&) {  // rank 0 knows
        }
      });
    }
  }
  ~PeerThreads() {
    for (std::thread& thread : threads_) thread.join();
  }
  /// Closes rank 0's ends.
  void leave() { peers_.clear(); }
  std::unique_ptr<Backend> backend(double deadline = 30) {
    PeerRules rules;
    rules.deadline = deadline;
    rules.why_lost = [](int) { return "it is gone"; };
    return make_ranked_backend(make_peer_crew(std::move(peers_), std::move(rules)), kRowsOfChunk);
  }

 private:
  std::vector<PeerSocket> peers_;
  std::vector<std::thread> threads_;
};

class PeerRun : public SceneRun {
 protected:
  PeerRun() : SceneRun(small_scene()) {}
  Work working(double deadline = 30) const {
    return [this, deadline](PeerSocket& leader, int rank, int count) {
      work_as_rank(leader, rank, count, deadline, scene_.train_views, photometric_);
    };
  }
  TrainingModel trained_by(int count, const Config& config) {
    photometric_ = config.photometric;
    PeerThreads threads(count, working());
    const auto backend = threads.backend();
    Trainer trainer(scene_, config, *backend);
    trainer.run();
    loss_ = trainer.loss();
    return copy_to(host_memory(), trainer.model());
  }
  void expect_same(const Config& config) {
    const TrainingModel expected = trained(config);
    for (const int count : {2, 3})
      EXPECT_TRUE(same_bits(trained_by(count, config), expected)) << "ranks: " << count;
  }
  std::string error_with(const Work& work, double deadline) {
    PeerThreads threads(3, work);
    const auto backend = threads.backend(deadline);
    Trainer trainer(scene_, run_in_batches(4), *backend);
    return error_of([&] { trainer.run(); });
  }
  static Config run_in_batches(int batch) {
    Config config = short_run();
    config.train.batch = batch;
    config.train.iterations = 60;
    config.density.from_step = config.density.every = 20;
    config.density.gradient_threshold = 1e-5f;
    config.render.background = Background::random;
    return config;
  }

  PhotometricConfig photometric_;
  double loss_ = 0;
};

TEST_F(PeerRun, HasTheBytesAndTheLossOfOneRank) {
  const Config config = run_in_batches(4);
  expect_same(config);
  Trainer one(scene_, config, *backend_);
  one.run();
  EXPECT_EQ(loss_, one.loss());
}

TEST_F(PeerRun, WithABudgetAndMomentsAsCodesHasTheBytesOfOneRank) {
  for (const MomentForm form : kCodeForms) {
    Config config = busy_run();
    config.train.batch = 3;
    config.optimizer.moments = form;
    expect_same(config);
  }
}

TEST_F(PeerRun, WithLightAndPosesHasTheBytesOfOneRank) {
  Config config = run_in_batches(3);
  config.photometric.model = "gains";
  config.photometric.vignetting = config.poses.refine = true;
  config.photometric.rate = 0.02f;
  config.poses.rate = 1e-3f;
  expect_same(config);
}

TEST_F(PeerRun, InSpaceAndTimeHasTheBytesOfOneRank) {
  Config config = run_in_batches(3);
  config.model.dynamic = config.model.time_colors = true;
  expect_same(config);
}

// ---- failures ----------------------------------------------------------------------------------

/// A source whose photo 1 cannot be read a second time.
class FailingPhotos final : public PhotoSource {
 public:
  explicit FailingPhotos(std::vector<View> views) : views_(std::move(views)) {}
  std::shared_ptr<const View> view(std::size_t index) override {
    if (index == 1 && ++requests_ >= 2)
      throw Error("cannot read view 1: it is damaged", ExitCode::bad_data);
    return std::make_shared<View>(views_[index]);
  }
  void prefetch_decode(std::size_t) override {}
  void release(std::size_t) override {}

 private:
  const std::vector<View> views_;
  std::atomic<int> requests_{0};
};

TEST_F(PeerRun, EndsWithTheMessageOfARankThatThrows) {
  const auto photos = std::make_shared<FailingPhotos>(scene_.train_views);
  std::vector<View> views = scene_.train_views;
  for (std::size_t i = 0; i < views.size(); ++i) {
    views[i].photo = {};
    views[i].source = photos;
    views[i].index = i;
  }
  const Work work = [&](PeerSocket& leader, int rank, int count) {
    work_as_rank(leader, rank, count, 30, views, {});
  };
  EXPECT_THAT(error_with(work, 30),
              AllOf(HasSubstr("rank "), HasSubstr(": cannot read view 1: it is damaged")));
}

TEST_F(PeerRun, EndsWhereARankEndsOrHangs) {
  const auto rank_2_leaves = [&](double stays) {
    return [=, this](PeerSocket& leader, int rank, int count) {
      if (rank == 1) return work_as_rank(leader, rank, count, 30, scene_.train_views, {});
      for (int i = 0; i < 2; ++i) {  // loss and model, and a shard
        next_frame(leader, PeerSocket::Seconds(30), [] {});
        leader.send(std::uint32_t(RankFrame::done), {}, PeerSocket::Seconds(30));
      }
      std::this_thread::sleep_for(PeerSocket::Seconds(stays));
    };
  };
  EXPECT_THAT(error_with(rank_2_leaves(0), 30), HasSubstr("rank 2: it is gone, so the run ends"));
  EXPECT_THAT(error_with(rank_2_leaves(6), 1.5), HasSubstr("rank 2: no sign of life for 1.5 s"));
}

TEST_F(PeerRun, EndsOtherRanksWhereRank0IsLost) {
  std::atomic<int> lost{0};
  {
    PeerThreads threads(3, [&](PeerSocket& leader, int rank, int count) {
      try {
        work_as_rank(leader, rank, count, 30, scene_.train_views, {});
      } catch (const PeerLost&) {
        ++lost;
        throw;
      }
    });
    threads.leave();
  }
  EXPECT_EQ(lost, 2);
}

}  // namespace
}  // namespace gs
