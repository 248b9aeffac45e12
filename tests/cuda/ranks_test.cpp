// SPDX-License-Identifier: Apache-2.0
// Models that several ranks on GPUs train have the bytes of one GPU. With one GPU all ranks are on
// it, each with its own stream and buffers. The ranks are driven by one thread, or work as
// processes do: then they are threads with a socket each, and link_test.cpp has what links real
// processes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "gs_train/photometric/photometric_start.h"
#include "gs_train/ranks/shards.h"
#include "tests/cuda/fused_step.h"
#include "tests/support/error_of.h"
#include "tests/support/gains.h"
#include "tests/support/peer_threads.h"
#include "tests/support/same_bits.h"
#include "tests/support/scene_run.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

using ::testing::HasSubstr;

constexpr std::size_t kChunkRowsOfTests = 32;  // so that a few hundred rows lie on all ranks

enum class Driver { one_thread, processes };

// Rank i on GPU i, and in turn where there are fewer.
int gpu_of_rank(int rank) { return rank % cuda::device_count(); }

// Some ranks, and the backend of rank 0.
class SomeRanks {
 public:
  SomeRanks(Driver driver, int count, const std::vector<View>& views,
            const PhotometricConfig& photometric = {}, double deadline = 30) {
    if (driver == Driver::one_thread) {
      std::vector<int> devices;
      for (int i = 0; i < count; ++i) devices.push_back(gpu_of_rank(i));
      backend_ = cuda::make_ranked_backend(devices, kChunkRowsOfTests);
      return;
    }
    links_ = cuda::make_thread_links(count);
    threads_.emplace(
        count, [&views, photometric, deadline, this](PeerSocket& leader, int rank, int ranks) {
          cuda::work_as_gpu_rank(gpu_of_rank(rank), leader, rank, ranks, deadline, views,
                                 photometric, std::move(links_[std::size_t(rank)]));
        });
    backend_ = cuda::make_process_backend(0, threads_->take_peers(), PeerThreads::rules(deadline),
                                          std::move(links_.front()), kChunkRowsOfTests);
  }
  Backend& operator*() { return *backend_; }
  Backend* operator->() { return backend_.get(); }

 private:
  std::vector<std::unique_ptr<cuda::DeviceLinks>> links_;
  std::optional<PeerThreads> threads_;  // which end when the backend does
  std::unique_ptr<Backend> backend_;
};

class CudaRanks : public FusedStepTest, public testing::WithParamInterface<Driver> {
 protected:
  static SomeRanks ranks_of(int count, const std::vector<View>& views,
                            const PhotometricConfig& photometric = {}) {
    return SomeRanks(GetParam(), count, views, photometric);
  }
  // The model after some steps by batches of `batch` photos, on any backend.
  static TrainingModel after_steps(Backend& backend, const TrainingModel& start,
                                   const std::vector<View>& views, const RenderSettings& settings,
                                   std::size_t batch, const DensityStep& density, int steps = 6) {
    backend.upload_views(views, std::size_t(1) << 30);
    TrainingModel model = copy_to(backend.memory(), start);
    std::vector<TrainingPhoto> photos = batch_of(views, settings);
    Update update{kRates, batch_rule(int(batch))};
    update.rounding_seed = 7;
    if (!model.photometric.empty()) {
      update.photometric_rate = 0.01f;
      update.photo_rule = update.rule;
      for (std::size_t i = 0; i < photos.size(); ++i) photos[i].photo_row = i;
    }
    for (int step = 0; step < steps; ++step) {
      std::vector<TrainingPhoto> of_step;
      for (std::size_t i = 0; i < batch; ++i)
        of_step.push_back(photos[(std::size_t(step) * batch + i) % photos.size()]);
      backend.step(model, {of_step.data(), of_step.size()}, {0.2f}, update, density);
    }
    backend.synchronize(model);
    return copy_to(host_memory(), model);
  }
  void expect_bytes_of_one_gpu(const TrainingModel& start, const std::vector<View>& views,
                               RenderSettings settings, const DensityStep& density) {
    settings.deterministic = true;
    for (const std::size_t batch : {1, 2, 4, 5}) {
      const TrainingModel expected = after_steps(gpu(), start, views, settings, batch, density);
      for (const int count : {1, 2, 3, 4}) {
        SomeRanks backend = ranks_of(count, views);
        EXPECT_TRUE(
            same_bits(after_steps(*backend, start, views, settings, batch, density), expected))
            << "batch " << batch << ", ranks " << count;
      }
    }
  }
};

TEST_P(CudaRanks, StepsHaveTheBytesOfOneGpu) {
  const std::vector<View> views = some_views(131, 77, 3);
  for (const bool has_time : {false, true})
    for (const int degree : {0, 3}) {
      SCOPED_TRACE(std::to_string(degree) + (has_time ? " in time" : ""));
      Gaussians start = random_gaussians(kTypical, 3000, views[0].camera, 5);
      if (has_time) start = in_spacetime(start, 8);
      RenderSettings settings;
      settings.sh_degree = degree;
      settings.absolute_gradient = degree == 0;
      expect_bytes_of_one_gpu(model_of(start), views, settings, {true});
    }
}

TEST_P(CudaRanks, ScoresRegularizersAndNoiseHaveTheBytesOfOneGpu) {
  const std::vector<View> views = some_views(131, 77, 3);
  const TrainingModel start = model_of(random_gaussians(kTypical, 3000, views[0].camera, 5));
  DensityStep density{.gather_statistics = true, .regularizers = {1e-2f, 1e-2f}};
  density.noise.scale = 5e4f;
  density.score = GrowthScore::force;
  expect_bytes_of_one_gpu(start, views, {}, density);
}

TEST_P(CudaRanks, MomentsAsCodesHaveTheBytesOfOneGpu) {
  const std::vector<View> views = some_views(131, 77, 3);
  expect_bytes_of_one_gpu(
      model_of(random_gaussians(kTypical, 3000, views[0].camera, 5), MomentStorage::halves), views,
      {}, {true});
}

TEST_P(CudaRanks, APhotometricModelHasTheBytesOfOneGpu) {
  const std::vector<View> views = some_views(131, 77, 3);
  const PhotometricConfig config{"gains"};
  TrainingModel start = model_of(random_gaussians(kTypical, 3000, views[0].camera, 5));
  begin_with_gains(config, views, start);
  RenderSettings settings;
  settings.deterministic = true;
  gpu().use_photometric(make_photometric_model(config));
  for (const std::size_t batch : {1, 2, 3, 5}) {
    const TrainingModel expected = after_steps(gpu(), start, views, settings, batch, {true});
    EXPECT_FALSE(same_bits(expected.photometric, start.photometric));
    for (const int count : {1, 2, 3}) {
      SomeRanks backend = ranks_of(count, views, config);
      backend->use_photometric(make_photometric_model(config));
      const TrainingModel actual = after_steps(*backend, start, views, settings, batch, {true});
      EXPECT_TRUE(same_bits(actual, expected)) << "batch " << batch << ", ranks " << count;
      EXPECT_TRUE(same_bits(actual.photometric, expected.photometric))
          << "batch " << batch << ", ranks " << count;
    }
  }

  gpu().use_photometric(nullptr);
}

// Without RenderSettings::deterministic, sums have another order each time.
TEST_P(CudaRanks, OtherStepsAreThoseOfTheScalarBackend) {
  const std::vector<View> views = some_views(131, 77, 3);
  const TrainingModel start = model_of(random_gaussians(kTypical, 3000, views[0].camera, 5));
  DensityStep density{.gather_statistics = true};
  density.score = GrowthScore::force;
  const TrainingModel expected = after_steps(cpu(), start, views, {}, 3, density);
  SomeRanks backend = ranks_of(2, views);
  expect_same(after_steps(*backend, start, views, {}, 3, density), expected, 2e-2);
}

// More instances than the forecast: all ranks repeat the step.
TEST_P(CudaRanks, StepsWithTooLittleRoomLoseNothing) {
  const std::vector<View> views = some_views(320, 240, 3);
  const Recipe large{
      .sigma_low = 30, .sigma_high = 60, .opacity_low = 0.02f, .opacity_high = 0.05f};
  const TrainingModel start = model_of(random_gaussians(large, 20000, views[0].camera, 3));
  RenderSettings settings;
  settings.deterministic = true;
  for (const std::size_t batch : {1, 3}) {
    const TrainingModel expected = after_steps(gpu(), start, views, settings, batch, {true});
    for (const int count : {2, 3}) {
      SomeRanks backend = ranks_of(count, views);
      EXPECT_TRUE(same_bits(after_steps(*backend, start, views, settings, batch, {true}), expected))
          << "batch " << batch << ", ranks " << count;
    }
  }
}

TEST_P(CudaRanks, DealtRowsComeBackAsTheyWere) {
  const std::vector<View> views = some_views(131, 77, 1);
  for (const std::size_t rows : {1, 31, 32, 33, 95, 96, 97, 1000}) {
    TrainingModel start = model_of(random_gaussians(kTypical, rows, views[0].camera, 5));
    SomeRanks backend = ranks_of(3, views);
    backend->upload_views(views, std::size_t(1) << 30);
    TrainingModel model = copy_to(backend->memory(), start);
    const TrainingPhoto photo{&views[0], {}};
    // rates of zero change no parameter
    backend->step(model, {&photo, 1}, {0.2f}, Update{}, {});
    EXPECT_NE(model.statistics.visits.size(), model.count());  // with the ranks
    backend->synchronize(model);
    EXPECT_TRUE(same_bits(copy_to(host_memory(), model).gaussians.mean, start.gaussians.mean))
        << rows;
  }
}

TEST_P(CudaRanks, RunsWithDensityControlHaveTheBytesOfOneGpu) {
  const Scene scene = small_scene();
  for (const int batch : {1, 4})
    for (const std::string strategy : {"adaptive", "mcmc", "taming"}) {
      Config config = short_run();
      config.train.deterministic = true;
      config.train.batch = batch;
      config.train.iterations = 90;
      config.density.strategy = strategy;
      config.density.from_step = config.density.every = 20;
      config.density.gradient_threshold = 1e-5f;
      if (strategy != "adaptive") config.density.max_gaussians = 200;
      const auto trained = [&](Backend& backend) { return model_of_run(scene, config, backend); };
      const TrainingModel expected = trained(gpu());
      for (const int count : {2, 3}) {
        SomeRanks backend = ranks_of(count, scene.train_views);
        EXPECT_TRUE(same_bits(trained(*backend), expected))
            << strategy << ", batch " << batch << ", ranks " << count;
      }
    }
}

TEST_P(CudaRanks, RefuseWhatTheyDoNotHave) {
  const std::vector<View> views = some_views(131, 77, 1);
  SomeRanks backend = ranks_of(2, views);
  EXPECT_THAT(error_of([&] { backend->check_refines_poses(); }), HasSubstr("train.ranks=1"));
  EXPECT_THAT(error_of([&] { backend->check_takes_depth(); }), HasSubstr("train.ranks=1"));
}

INSTANTIATE_TEST_SUITE_P(OfOneThread, CudaRanks, testing::Values(Driver::one_thread));
INSTANTIATE_TEST_SUITE_P(OfProcesses, CudaRanks, testing::Values(Driver::processes));

// ---- failures of processes ----------------------------------------------------------------------

class CudaProcesses : public FusedStepTest {
 protected:
  // What a run says whose ranks do as they are told: a step of three photos, again and again.
  static std::string error_of_steps(SomeRanks& backend, const std::vector<View>& views) {
    const TrainingModel start = model_of(random_gaussians(kTypical, 3000, views[0].camera, 5));
    return error_of([&] {
      backend->upload_views(views, 0);  // no photo stays on a GPU
      TrainingModel model = copy_to(backend->memory(), start);
      const std::vector<TrainingPhoto> batch = batch_of(views, {});
      for (int step = 0; step < 200; ++step)
        backend->step(model, {batch.data(), batch.size()}, {0.2f}, Update{kRates, batch_rule(3)},
                      {true});
      backend->synchronize(model);
    });
  }
};

/// Photos of which one cannot be read after some requests; or reading it takes long.
class BadPhotos final : public PhotoSource {
 public:
  BadPhotos(std::vector<View> views, double seconds)
      : views_(std::move(views)), seconds_(seconds) {}
  std::shared_ptr<const View> view(std::size_t index) override {
    if (index == 1 && ++requests_ >= 20) {
      if (seconds_ == 0) throw Error("cannot read view 1: it is damaged", ExitCode::bad_data);
      std::this_thread::sleep_for(std::chrono::duration<double>(seconds_));
    }
    return std::make_shared<View>(views_[index]);
  }
  void prefetch_decode(std::size_t) override {}
  void release(std::size_t) override {}

 private:
  const std::vector<View> views_;
  const double seconds_;
  std::atomic<int> requests_{0};
};

std::vector<View> with_source(const std::vector<View>& views, double seconds) {
  const auto photos = std::make_shared<BadPhotos>(views, seconds);
  std::vector<View> all = views;
  for (std::size_t i = 0; i < all.size(); ++i) {
    all[i].photo = {};
    all[i].source = photos;
    all[i].index = i;
  }
  return all;
}

// Rank 1 draws the second photo of each batch.
TEST_F(CudaProcesses, EndWithTheMessageOfTheRankThatThrows) {
  const std::vector<View> views = some_views(131, 77, 3), bad = with_source(views, 0);
  SomeRanks backend(Driver::processes, 3, bad);
  EXPECT_THAT(error_of_steps(backend, bad), HasSubstr("rank 1: cannot read view 1: it is damaged"));
}

TEST_F(CudaProcesses, EndWhereARankHangs) {
  const std::vector<View> views = some_views(131, 77, 3), slow = with_source(views, 5);
  SomeRanks backend(Driver::processes, 3, slow, {}, 1.5);
  EXPECT_THAT(error_of_steps(backend, slow), HasSubstr("rank 1: no sign of life for 1.5 s"));
}

}  // namespace
}  // namespace gs
