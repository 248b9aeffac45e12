// SPDX-License-Identifier: Apache-2.0
// Models that several GPUs train have the bytes of one GPU. Where there is only one, it counts as
// several, each with a stream and buffers of its own.
#include "tests/cuda/fused_step.h"
#include "tests/support/gains.h"
#include "tests/support/poses.h"

namespace gs {
namespace {

constexpr std::size_t kFewRows = 32;     // of a chunk, so that a few hundred rows lie on all GPUs
constexpr std::size_t kOfCameras = 256;  // of a chunk, at least, where poses are refined

std::unique_ptr<Backend> backend_of(int gpus, std::size_t chunk_rows = kFewRows) {
  std::vector<int> devices;
  for (int i = 0; i < gpus; ++i) devices.push_back(i % cuda::device_count());
  return cuda::make_backend(devices, chunk_rows);
}

class CudaGpus : public FusedStepTest {
 protected:
  // The model after some steps by batches of `batch` photos, on any backend.
  static TrainingModel after_steps(Backend& backend, const TrainingModel& start,
                                   const std::vector<View>& views, const RenderSettings& settings,
                                   std::size_t batch, const DensityStep& density,
                                   float depth_weight = 0) {
    backend.device().upload_views(views, std::size_t(1) << 30);
    TrainingModel model = copy_to(backend.memory(), start);
    std::vector<TrainingPhoto> photos = batch_of(views, settings);
    Update update{kRates, batch_rule(int(batch))};
    update.rounding_seed = 7;
    update.photo_rule = update.rule;
    if (!model.photometric.empty()) update.photometric_rate = 0.01f;
    if (!model.poses.empty()) update.pose_rate = 1e-3f;
    for (std::size_t i = 0; i < photos.size(); ++i) photos[i].photo_row = i;
    LossSettings loss{0.2f};
    loss.depth_weight = depth_weight;
    for (int step = 0; step < 6; ++step) {
      std::vector<TrainingPhoto> of_step;
      for (std::size_t i = 0; i < batch; ++i)
        of_step.push_back(photos[(std::size_t(step) * batch + i) % photos.size()]);
      backend.step(model, {{of_step.data(), of_step.size()}, loss, update, density});
    }
    backend.synchronize(model);
    return copy_to(host_memory(), model);
  }
  void expect_bytes_of_one_gpu(const TrainingModel& start, const std::vector<View>& views,
                               RenderSettings settings, const DensityStep& density) {
    settings.deterministic = true;
    for (const std::size_t batch : {1, 2, 4, 5, 8}) {
      const TrainingModel expected = after_steps(gpu(), start, views, settings, batch, density);
      for (const int count : {2, 3, 4}) {
        const auto backend = backend_of(count);
        EXPECT_TRUE(
            same_bits(after_steps(*backend, start, views, settings, batch, density), expected))
            << "batch " << batch << ", GPUs " << count;
      }
    }
  }
};

TEST_F(CudaGpus, StepsHaveTheBytesOfOneGpu) {
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

TEST_F(CudaGpus, ScoresRegularizersAndNoiseHaveTheBytesOfOneGpu) {
  const std::vector<View> views = some_views(131, 77, 3);
  const TrainingModel start = model_of(random_gaussians(kTypical, 3000, views[0].camera, 5));
  DensityStep density{.gather_statistics = true, .regularizers = {1e-2f, 1e-2f}};
  density.noise.scale = 5e4f;
  density.score = GrowthScore::force;
  expect_bytes_of_one_gpu(start, views, {}, density);
}

TEST_F(CudaGpus, HalfMomentsHaveTheBytesOfOneGpu) {
  const std::vector<View> views = some_views(131, 77, 3);
  expect_bytes_of_one_gpu(
      model_of(random_gaussians(kTypical, 3000, views[0].camera, 5), MomentStorage::halves), views,
      {}, {true});
}

// What is learned of photos, and their depth maps: in each combination, by batches of all sizes.
struct OfPhotos {
  bool has_gains, has_poses, has_depth;
};

class CudaGpusOfPhotos : public CudaGpus, public testing::WithParamInterface<OfPhotos> {
 protected:
  static std::vector<View> views_with_maps() {
    std::vector<View> views = some_views(131, 77, 3);
    Draws draws(40);
    for (View& view : views) {
      view.depth = ImageF(131, 77, 1);
      view.depth_kind = DepthKind::scaled;
      view.has_depth_map = true;
      for (float& value : view.depth.pixels) value = draws.chance(0.1f) ? 0 : draws.uniform(1, 6);
    }
    return views;
  }
  static TrainingModel started(const Gaussians& gaussians, const std::vector<View>& views) {
    TrainingModel model = model_of(gaussians);
    if (GetParam().has_gains) begin_with_gains({"gains"}, views, model);
    if (!GetParam().has_poses) return model;
    Config config = adaptive_config();
    config.poses.refine = true;
    Scene scene;
    scene.train_views = views;
    scene.extent = 0.5f;
    begin_poses(config, scene, model);
    disturb(model.poses, 0.005, 0.01);
    return model;
  }
  static std::shared_ptr<const PhotometricModel> model_of_light() {
    if (!GetParam().has_gains) return nullptr;
    return make_photometric_model(PhotometricConfig{"gains"});
  }
};

TEST_P(CudaGpusOfPhotos, HaveTheBytesOfOneGpu) {
  const std::vector<View> views = views_with_maps();
  const float depth_weight = GetParam().has_depth ? 2.0f : 0.0f;
  RenderSettings settings;
  settings.deterministic = true;
  DensityStep density{.gather_statistics = true};
  density.score = GrowthScore::force;
  for (const bool has_time : {false, true}) {
    Gaussians gaussians = random_gaussians(kTypical, 3000, views[0].camera, 5);
    if (has_time) gaussians = in_spacetime(gaussians, 8);
    const TrainingModel start = started(gaussians, views);
    gpu().use({.photometric = model_of_light()});
    for (const std::size_t batch : {1, 2, 3, 5, 8}) {
      const TrainingModel expected =
          after_steps(gpu(), start, views, settings, batch, density, depth_weight);
      EXPECT_EQ(same_bits(expected.photometric, start.photometric), !GetParam().has_gains);
      EXPECT_EQ(same_bits(expected.poses, start.poses), !GetParam().has_poses);
      for (const int count : {2, 3}) {
        const auto backend = backend_of(count, kOfCameras);
        backend->use({.photometric = model_of_light()});
        const TrainingModel actual =
            after_steps(*backend, start, views, settings, batch, density, depth_weight);
        const std::string what = "batch " + std::to_string(batch) + ", GPUs " +
                                 std::to_string(count) + (has_time ? " in time" : "");
        EXPECT_TRUE(same_bits(actual, expected)) << what;
        EXPECT_TRUE(same_bits(actual.photometric, expected.photometric)) << what;
        EXPECT_TRUE(same_bits(actual.poses, expected.poses)) << what;
      }
    }
  }
  gpu().use({});
}

INSTANTIATE_TEST_SUITE_P(Each, CudaGpusOfPhotos,
                         testing::Values(OfPhotos{true, false, false}, OfPhotos{false, true, false},
                                         OfPhotos{false, false, true}, OfPhotos{true, true, true}));

// Forces of photos with a depth map are summed apart from the gradients.
TEST_F(CudaGpus, ForcesOfPhotosWithDepthMapsAreThoseOfTheScalarBackend) {
  std::vector<View> views = some_views(131, 77, 3);
  for (View& view : views) {
    view.depth = ImageF(131, 77, 1, 3.0f);
    view.depth_kind = DepthKind::metric;
    view.has_depth_map = true;
  }
  const TrainingModel start = model_of(random_gaussians(kTypical, 3000, views[0].camera, 5));
  DensityStep density{.gather_statistics = true};
  density.score = GrowthScore::force;
  const TrainingModel expected = after_steps(cpu(), start, views, {}, 3, density, 2);
  const auto backend = backend_of(2);
  const TrainingModel actual = after_steps(*backend, start, views, {}, 3, density, 2);
  expect_same(actual, expected, 2e-2);
  expect_same_sums(actual, expected, 2e-2);
}

// Without RenderSettings::deterministic, sums have another order each time.
TEST_F(CudaGpus, OtherStepsAreThoseOfTheScalarBackend) {
  const std::vector<View> views = some_views(131, 77, 3);
  const TrainingModel start = model_of(random_gaussians(kTypical, 3000, views[0].camera, 5));
  DensityStep density{.gather_statistics = true};
  density.score = GrowthScore::force;
  const TrainingModel expected = after_steps(cpu(), start, views, {}, 3, density);
  const auto backend = backend_of(2);
  expect_same(after_steps(*backend, start, views, {}, 3, density), expected, 2e-2);
}

// More instances than the forecast: all GPUs repeat the step.
TEST_F(CudaGpus, StepsWithTooLittleRoomLoseNothing) {
  const std::vector<View> views = some_views(320, 240, 3);
  const Recipe large{
      .sigma_low = 30, .sigma_high = 60, .opacity_low = 0.02f, .opacity_high = 0.05f};
  const TrainingModel start = model_of(random_gaussians(large, 20000, views[0].camera, 3));
  RenderSettings settings;
  settings.deterministic = true;
  for (const std::size_t batch : {1, 3}) {
    const TrainingModel expected = after_steps(gpu(), start, views, settings, batch, {true});
    for (const int count : {2, 3}) {
      const auto backend = backend_of(count);
      EXPECT_TRUE(same_bits(after_steps(*backend, start, views, settings, batch, {true}), expected))
          << "batch " << batch << ", GPUs " << count;
    }
  }
}

TEST_F(CudaGpus, DealtRowsComeBackAsTheyWere) {
  const std::vector<View> views = some_views(131, 77, 1);
  for (const std::size_t rows : {1, 31, 32, 33, 95, 96, 97, 1000}) {
    TrainingModel start = model_of(random_gaussians(kTypical, rows, views[0].camera, 5));
    const auto backend = backend_of(3);
    backend->device().upload_views(views, std::size_t(1) << 30);
    TrainingModel model = copy_to(backend->memory(), start);
    const TrainingPhoto photo{&views[0], {}};
    // rates of zero change no parameter
    backend->step(model, {{&photo, 1}, {0.2f}, Update{}, {}});
    EXPECT_NE(model.statistics.visits.size(), model.count());  // with the GPUs
    backend->synchronize(model);
    EXPECT_TRUE(same_bits(copy_to(host_memory(), model).gaussians.mean, start.gaussians.mean))
        << rows;
  }
}

// A model that takes the place of a dealt one, as after a breakdown, is dealt anew.
TEST_F(CudaGpus, AModelThatWasReplacedIsTheOneThatIsTrained) {
  const std::vector<View> views = some_views(131, 77, 1);
  const TrainingModel start = model_of(random_gaussians(kTypical, 1000, views[0].camera, 5));
  const TrainingPhoto photo{&views[0], {}};
  const auto backend = backend_of(2);
  backend->device().upload_views(views, std::size_t(1) << 30);
  TrainingModel model = copy_to(backend->memory(), start);
  backend->step(model, {{&photo, 1}, {0.2f}, Update{kRates}, {}});
  model = copy_to(backend->memory(), start);
  backend->step(model, {{&photo, 1}, {0.2f}, Update{}, {}});
  EXPECT_EQ(backend->rows().count_not_finite(model), 0u);
  EXPECT_TRUE(same_bits(copy_to(host_memory(), model).gaussians.mean, start.gaussians.mean));
}

TEST_F(CudaGpus, RunsWithDensityControlHaveTheBytesOfOneGpu) {
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
        const auto backend = backend_of(count);
        EXPECT_TRUE(same_bits(trained(*backend), expected))
            << strategy << ", batch " << batch << ", GPUs " << count;
      }
    }
}

// Stopped, and gone on with another number of GPUs.
TEST_F(CudaGpus, RunsGoOnWithAnyNumberOfGpus) {
  const Scene scene = small_scene();
  Config config = growing_run(90);
  config.train.deterministic = true;
  config.train.batch = 3;
  config.photometric.model = "gains";
  config.poses.refine = true;
  const TrainingModel expected = model_of_run(scene, config, gpu());
  for (const int stop : {3, 27, 60})
    for (const auto& [before, after] : {std::pair{1, 2}, {2, 1}, {3, 2}}) {
      const auto first = backend_of(before, kOfCameras), second = backend_of(after, kOfCameras);
      Trainer resumed(scene, config, *second, stopped_after(stop, scene, config, *first));
      resumed.run();
      const TrainingModel actual = copy_to(host_memory(), resumed.model());
      EXPECT_TRUE(same_bits(actual, expected) && same_bits(actual.poses, expected.poses))
          << "after step " << stop << " on " << before << ", then on " << after;
    }
}

}  // namespace
}  // namespace gs
