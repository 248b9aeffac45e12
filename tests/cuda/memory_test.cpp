// SPDX-License-Identifier: Apache-2.0
// What training takes of the GPU's memory, compared with training_bytes().
#include "data_loaders/scene/load_scene.h"
#include "gs_core/forecast/gpu_step.h"
#include "gs_core/forecast/training_memory.h"
#include "tests/support/cuda.h"

namespace gs {
namespace {

constexpr double kTolerance = 0.1;  // what docs/develop/architecture.md promises
constexpr double kMib = 1 << 20;
const Recipe kSmall{.sigma_low = 0.5f, .sigma_high = 2};

/// The bytes that this process allocates on the GPU at most, from now on.
class PeakSince {
 public:
  PeakSince() : before_(cuda::usage().allocated_bytes) { cuda::restart_peak(); }
  double bytes() const { return double(cuda::usage().peak_allocated_bytes - before_); }

 private:
  std::size_t before_;
};

void expect_forecast(double measured, double forecast) {
  ::testing::Test::RecordProperty("measured_mib", std::to_string(measured / kMib));
  ::testing::Test::RecordProperty("forecast_mib", std::to_string(forecast / kMib));
  EXPECT_NEAR(forecast, measured, kTolerance * measured)
      << "forecast " << forecast / kMib << " MiB, measured " << measured / kMib << " MiB";
}

// ---- steps of a model that stays as it is ------------------------------------------------------

class CudaMemory : public CudaTest {
 protected:
  void SetUp() override {
    CudaTest::SetUp();
    if (IsSkipped()) return;
    for (int i = 0; i < 4; ++i) {
      View view;
      view.name = std::to_string(i);
      view.camera = random_camera(640, 480, 1);
      view.camera.cx += float(5 * i);
      view.photo = random_photo(640, 480, std::uint64_t(i));
      views_.push_back(std::move(view));
    }
    rows_ = random_gaussians(kSmall, 300'000, views_[0].camera, 3);
    for (const View& view : views_) {
      RenderPass pass;
      cpu().renderer().forward(rows_.span(), view.camera, {}, pass);
      std::size_t instances = 0;
      for (const std::uint32_t tiles : pass.tile_counts.download()) instances += tiles;
      most_instances_ = std::max(most_instances_, double(instances));
    }
  }

  /// `change` sets what this run has more than a plain one, for the step and for the forecast.
  template <class Change>
  void expect_steps_as_forecast(Change&& change) {
    RenderSettings settings;
    DensityStep density{.gather_statistics = true};
    TrainingSize size;
    size.growth = RowGrowth::none;
    size.gaussians = double(rows_.count());
    const PictureSizes pictures = picture_sizes(views_);
    size.pixels = pictures.pixels;
    size.photo_bytes = pictures.photo_bytes;
    size.instance_places = capacity_of_views(rows_.count(), most_instances_) / size.gaussians;
    change(settings, density, size);
    const PeakSince peak;
    const std::unique_ptr<Backend> backend = cuda::make_backend({0});
    TrainingModel model = copy_to(backend->memory(), model_of(rows_));
    backend->device().upload_views(views_, std::size_t(1) << 30);
    std::vector<TrainingPhoto> photos;
    for (const View& view : views_) photos.push_back({&view, settings});
    photos.resize(2 * photos.size(), photos.front());  // a batch may end beyond the views
    for (int step = 0; step < 12; step += size.batch)
      backend->step(model, {{&photos[std::size_t(step) % views_.size()], std::size_t(size.batch)},
                            {0.2f},
                            Update{kRates},
                            density});
    backend->synchronize(model);
    expect_forecast(peak.bytes(), training_bytes(size));
  }

  std::vector<View> views_;
  Gaussians rows_;
  double most_instances_ = 0;
};

TEST_F(CudaMemory, StepsTakeWhatIsForecast) {
  expect_steps_as_forecast([](RenderSettings&, DensityStep&, TrainingSize&) {});
}

TEST_F(CudaMemory, DeterministicStepsTakeWhatIsForecast) {
  expect_steps_as_forecast([](RenderSettings& settings, DensityStep&, TrainingSize& size) {
    settings.deterministic = size.is_deterministic = true;
  });
}

TEST_F(CudaMemory, StepsWithSumsOverFragmentsTakeWhatIsForecast) {
  expect_steps_as_forecast([](RenderSettings&, DensityStep& density, TrainingSize& size) {
    density.score = GrowthScore::force;
    size.has_sums = true;
  });
}

TEST_F(CudaMemory, BatchesTakeWhatIsForecast) {
  for (const int batch : {2, 4, 6})
    for (const bool has_sums : {false, true})
      for (const bool is_deterministic : {false, true}) {
        SCOPED_TRACE(batch);
        expect_steps_as_forecast(
            [&](RenderSettings& settings, DensityStep& density, TrainingSize& size) {
              size.batch = batch;
              settings.deterministic = size.is_deterministic = is_deterministic;
              size.has_sums = has_sums;
              if (has_sums) density.score = GrowthScore::force;
            });
      }
}

TEST_F(CudaMemory, StepsInSpaceAndTimeTakeWhatIsForecast) {
  rows_ = in_spacetime(rows_, 8);
  for (const int batch : {1, 4})
    expect_steps_as_forecast([&](RenderSettings&, DensityStep&, TrainingSize& size) {
      size.has_time = true;
      size.batch = batch;
    });
}

// ---- runs, whose Gaussians become more ---------------------------------------------------------

/// Remembers the most Gaussians of a run.
class MostRows final : public Observer {
 public:
  void after_step(int, Trainer& trainer) override {
    most = std::max(most, double(trainer.gaussian_count()));
  }
  double most = 0;
};

class CudaMemoryOfRuns : public CudaTest {
 protected:
  static void expect_run_as_forecast(Config config) {
    config.dataset.source = std::string(GS_SOURCE_DIR) + "/examples/courtyard";
    const Scene scene = load_scene(config.dataset);
    const PeakSince peak;
    const std::unique_ptr<Backend> backend = cuda::make_backend({0});
    Trainer trainer(scene, config, *backend);
    MostRows rows;
    trainer.add_observer(rows);
    trainer.run();
    const Config& settled = trainer.config();
    const double count = rises_to_cap(settled) ? double(settled.density.max_gaussians) : rows.most;
    ::testing::Test::RecordProperty("gaussians", std::to_string(rows.most));
    expect_forecast(peak.bytes(), training_bytes(training_size(
                                      settled, picture_sizes(scene.train_views), count)));
  }
};

TEST_F(CudaMemoryOfRuns, ARunUpToANumberTakesWhatIsForecast) {
  Config config;
  config.density.max_gaussians = 400'000;
  config.train.iterations = 30000;
  config.train.steps_scaler = 0.1f;
  expect_run_as_forecast(config);
}

TEST_F(CudaMemoryOfRuns, AnAdaptiveRunTakesWhatIsForecast) {
  Config config = adaptive_config();
  config.train.steps_scaler = 0.1f;
  expect_run_as_forecast(config);
}

}  // namespace
}  // namespace gs
