// SPDX-License-Identifier: Apache-2.0
// Ranks that talk over sockets end in the bytes of one rank, and in one message where one of them
// fails. Here they are threads with a socket each; tests/cli/ranks_test.cpp has processes.
#include "gs_train/ranks/peer_ranks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "gs_core/error.h"
#include "gs_train/ranks/peer_communicator.h"
#include "gs_train/ranks/ranked_backend.h"
#include "tests/support/error_of.h"
#include "tests/support/peer_threads.h"
#include "tests/support/scene_run.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr std::size_t kRowsOfChunk = 5;  // so that a few dozen Gaussians lie on all ranks

std::unique_ptr<Backend> backend_of(PeerThreads& threads, double deadline = 30) {
  return make_ranked_backend(make_peer_crew(threads.take_peers(), PeerThreads::rules(deadline)),
                             kRowsOfChunk);
}

class PeerRun : public SceneRun {
 protected:
  PeerRun() : SceneRun(small_scene()) {}
  PeerWork working(double deadline = 30) const {
    return [this, deadline](PeerSocket& leader, int rank, int count) {
      work_as_rank(leader, rank, count, deadline, scene_.train_views, photometric_);
    };
  }
  TrainingModel trained_by(int count, const Config& config) {
    photometric_ = config.photometric;
    PeerThreads threads(count, working());
    const auto backend = backend_of(threads);
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
  std::string error_with(const PeerWork& work, double deadline) {
    PeerThreads threads(3, work);
    const auto backend = backend_of(threads, deadline);
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
  Config config = busy_run();
  config.train.batch = 3;
  config.optimizer.moments = MomentStorage::halves;
  expect_same(config);
}

TEST_F(PeerRun, WithLightAndPosesHasTheBytesOfOneRank) {
  Config config = run_in_batches(3);
  config.photometric.model = "gains";
  config.poses.refine = true;
  config.photometric.rate = 0.02f;
  config.poses.rate = 1e-3f;
  expect_same(config);
}

TEST_F(PeerRun, InSpaceAndTimeHasTheBytesOfOneRank) {
  Config config = run_in_batches(3);
  config.model.dynamic = true;
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
  const PeerWork work = [&](PeerSocket& leader, int rank, int count) {
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

TEST_F(PeerRun, EndsWhereARankHangsWhileItLoads) {
  const PeerSocket::Seconds long_enough(30);
  const auto error_of_loading = [&](const PeerWork& load) {
    PeerThreads threads(3, [&](PeerSocket& leader, int rank, int count) {
      EXPECT_EQ(RankFrame(leader.receive(long_enough).kind), RankFrame::setup);
      if (rank == 2) load(leader, rank, count);
      leader.send(std::uint32_t(RankFrame::ready), {}, long_enough);
      work_as_rank(leader, rank, count, 1.5, scene_.train_views, {});
    });
    PeerRules rules = PeerThreads::rules(1.5);
    rules.setup = [] { return std::vector<std::byte>(); };
    const auto backend =
        make_ranked_backend(make_peer_crew(threads.take_peers(), rules), kRowsOfChunk);
    try {
      Trainer trainer(scene_, run_in_batches(4), *backend);  // announces its views
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(error_of_loading([](PeerSocket&, int, int) {
                std::this_thread::sleep_for(PeerSocket::Seconds(4));
              }),
              HasSubstr("rank 2: no sign of life for 1.5 s"));
  EXPECT_EQ(error_of_loading([&](PeerSocket& leader, int, int) {
              for (int sign = 0; sign < 12; ++sign) {  // 3 s of work
                std::this_thread::sleep_for(PeerSocket::Seconds(0.25));
                leader.send(std::uint32_t(RankFrame::alive), {}, long_enough);
              }
            }),
            "");
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
    threads.take_peers();  // and closes them
  }
  EXPECT_EQ(lost, 2);
}

// ---- ranks that answer nothing for a while -----------------------------------------------------

// Rank 0 watches rank 1, which does as `work` says, and finds nothing, or the failure.
std::string seen_by_watch(const PeerWork& work, double deadline) {
  PeerThreads threads(2, work);
  std::vector<PeerSocket> peers = threads.take_peers();
  LeaderCommunicator others(peers, PeerSocket::Seconds(deadline));
  others.begin_watch();
  try {
    for (int i = 0; i < 100; ++i) {
      others.keep_watch();
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  } catch (const RankFailed& failed) {
    if (!failed.message.empty())
      return error_of([&] { throw_failure(failed.rank, failed.message); });
    return failed.lost.is_silent ? "silent" : "lost";
  }
  return "nothing";
}

TEST(Watch, SeesWhoFailsEndsOrHangs) {
  const auto sign_every = [](double seconds) {
    return [=](PeerSocket& leader, int, int) {
      for (;;) {
        leader.send(std::uint32_t(RankFrame::alive), {}, PeerSocket::Seconds(1));
        std::this_thread::sleep_for(PeerSocket::Seconds(seconds));
      }
    };
  };
  EXPECT_EQ(seen_by_watch(sign_every(0.1), 1), "nothing");
  EXPECT_EQ(seen_by_watch(sign_every(2.5), 1), "silent");
  EXPECT_EQ(seen_by_watch([](PeerSocket&, int, int) {}, 1), "lost");
  EXPECT_EQ(seen_by_watch(
                [](PeerSocket& leader, int, int) {
                  leader.send(std::uint32_t(RankFrame::failed), failure_message(Error("no disk")),
                              PeerSocket::Seconds(1));
                },
                1),
            "rank 1: no disk");
}

TEST(Watch, KeepsAnswersForWhoWaitsForThem) {
  PeerThreads threads(2, [](PeerSocket& leader, int, int) {
    leader.send(std::uint32_t(RankFrame::done), std::vector<std::byte>(3), PeerSocket::Seconds(1));
    leader.send(std::uint32_t(RankFrame::done), std::vector<std::byte>(4), PeerSocket::Seconds(1));
    leader.wait_for_more();
  });
  std::vector<PeerSocket> peers = threads.take_peers();
  LeaderCommunicator others(peers, PeerSocket::Seconds(5));
  EXPECT_TRUE(peers.front().has_more(PeerSocket::Seconds(5)));
  others.begin_watch();
  others.keep_watch();
  EXPECT_EQ(others.wait_for(1, RankFrame::done).size(), 3u);
  EXPECT_EQ(others.receive(1, RankFrame::done).size(), 4u);
}

TEST(Watch, OnAThreadSeesThatAConnectionIsClosed) {
  std::atomic<bool> may_leave = false, is_lost = false;
  PeerThreads threads(2, [&](PeerSocket&, int, int) {
    while (!may_leave) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  });
  const std::vector<PeerSocket> peers = threads.take_peers();
  const PeerWatch watch({&peers.front()}, [&] { is_lost = true; });
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_FALSE(is_lost);
  may_leave = true;
  for (int i = 0; i < 200 && !is_lost; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_TRUE(is_lost);
}

}  // namespace
}  // namespace gs
