// SPDX-License-Identifier: Apache-2.0
// HalfMoments (optimizer.moments) on the GPU: updates and row operations against the scalar twin, and
// whole runs.
#include "tests/cuda/every_model.h"
#include "tests/support/poses.h"

namespace gs {
namespace {

std::vector<View> some_views(int count = 3) { return shifted_views(count, 3, false); }

class CudaMoments : public CudaTest {
 protected:
  /// Compares parameters, opened moments and statistics.
  void expect_same(const TrainingModel& actual, const TrainingModel& expected, double tolerance) {
    ASSERT_EQ(actual.moment_storage(), MomentStorage::halves);
    const OpenedMoments a = opened(actual), b = opened(expected);
    const auto compare = [](const std::string& what, const auto& x, const auto& y, double most) {
      EXPECT_LT(norm_difference(downloaded(x), downloaded(y)), most) << what;
    };
    const auto compare_all = [&](const std::string& what, const Gaussians& x, const Gaussians& y,
                                 double most) {
      for_each_array([&](const char* name, const auto& of_x,
                         const auto& of_y) { compare(what + name, of_x, of_y, most); },
                     x, y);
    };
    compare_all("", actual.gaussians, expected.gaussians, tolerance);
    // Where the last bits of two gradients decide, they differ by an eighth or a quarter.
    compare_all("m of ", a.first, b.first, 5 * tolerance);
    compare_all("v of ", a.second, b.second, 10 * tolerance);
    compare("visits", actual.statistics.visits, expected.statistics.visits, tolerance);
    compare("gradient_norm", actual.statistics.gradient_norm, expected.statistics.gradient_norm,
            tolerance);
    EXPECT_EQ(actual.adam_steps, expected.adam_steps);
  }
  /// Steps of both backends by each view.
  void expect_same_steps(const Gaussians& start, const RenderSettings& settings,
                         const DensityStep& density) {
    const std::vector<View> views = some_views();
    TrainingModel expected = model_of(start, MomentStorage::halves);
    TrainingModel fused = on_gpu(expected);
    for (const View& view : views) {
      const TrainingPhoto photo{&view, settings};
      cpu().step(expected, {{&photo, 1}, {0.2f}, update_of(), density});
      gpu().step(fused, {{&photo, 1}, {0.2f}, update_of(), density});
      gpu().synchronize(fused);
    }
    expect_same(on_host(fused), expected, 2e-2);
  }
};

TEST_F(CudaMoments, OfAFusedStepAreThoseOfTheScalarTwin) {
  for (const Gaussians& start : all_forms(some_views()[0].camera))
    for (const int degree : {0, 1, 2, 3}) {
      SCOPED_TRACE(degree);
      RenderSettings settings;
      settings.sh_degree = degree;
      expect_same_steps(start, settings, {true});
    }
}

TEST_F(CudaMoments, OfAStepWithRegularizersAndAbsoluteGradientsAreThoseOfTheScalarTwin) {
  for (const Gaussians& start : all_forms(some_views()[0].camera)) {
    RenderSettings settings;
    settings.absolute_gradient = true;
    DensityStep density{.gather_statistics = true, .regularizers = {1e-3f, 1e-3f}};
    density.noise = {5e4f, {3, RandomStream::position_noise}, 1};
    expect_same_steps(start, settings, density);
  }
}

TEST_F(CudaMoments, OfABatchAreThoseOfTheScalarTwin) {
  const std::vector<View> views = some_views();
  for (const Gaussians& start : all_forms(views[0].camera))
    for (const int degree : {1, 2, 3}) {
      SCOPED_TRACE(testing::Message() << "degree " << degree);
      RenderSettings settings;
      settings.sh_degree = degree;
      std::vector<TrainingPhoto> batch;
      for (const View& view : views) batch.push_back({&view, settings});
      TrainingModel expected = model_of(start, MomentStorage::halves);
      TrainingModel fused = on_gpu(expected);
      const DensityStep density{.gather_statistics = true, .regularizers = {1e-3f, 1e-3f}};
      for (int i = 0; i < 3; ++i) {
        cpu().step(expected, {{batch.data(), batch.size()}, {0.2f}, update_of(3), density});
        gpu().step(fused, {{batch.data(), batch.size()}, {0.2f}, update_of(3), density});
      }
      gpu().synchronize(fused);
      EXPECT_EQ(fused.adam_steps, 9);
      expect_same(on_host(fused), expected, 2e-2);
    }
}

// Counts of rows that fill neither a warp nor a vector of four numbers.
TEST_F(CudaMoments, OfAnyNumberOfRowsAreThoseOfTheScalarTwin) {
  const std::vector<View> views = some_views(2);
  for (const std::size_t count : {1, 2, 31, 32, 33, 65}) {
    SCOPED_TRACE(count);
    const Gaussians start = random_gaussians(kTypical, count, views[0].camera, 4);
    expect_same_steps(start, {}, {true});
    TrainingModel expected = model_of(start, MomentStorage::halves);
    TrainingModel fused = on_gpu(expected);
    const TrainingPhoto batch[] = {{&views[0], {}}, {&views[1], {}}};
    cpu().step(expected, {{batch, 2}, {0.2f}, update_of(2), {true}});
    gpu().step(fused, {{batch, 2}, {0.2f}, update_of(2), {true}});
    gpu().synchronize(fused);
    expect_same(on_host(fused), expected, 2e-2);
  }
}

TEST_F(CudaMoments, OfAStepThatRefinesPosesAreThoseOfTheScalarTwin) {
  Scene scene;
  scene.train_views = some_views();
  scene.extent = 0.5f;
  const Camera& camera = scene.train_views[0].camera;
  for (const Gaussians& start : all_forms(camera)) {
    TrainingModel expected = model_of(start, MomentStorage::halves);
    Config config = adaptive_config();
    config.poses.refine = true;
    begin_poses(config, scene, expected);
    disturb(expected.poses, 0.005, 0.01);
    TrainingModel actual = on_gpu(expected);
    Update update = update_of();
    update.pose_rate = 1e-4f;
    update.photo_rule = batch_rule(1);
    for (std::size_t row = 0; row < 3; ++row) {
      const TrainingPhoto photo{&scene.train_views[row], {}, 1, row};
      gpu().step(actual, {{&photo, 1}, {0.2f}, update, {true}});
      cpu().step(expected, {{&photo, 1}, {0.2f}, update, {true}});
    }
    gpu().synchronize(actual);
    expect_same(on_host(actual), expected, 2e-2);
  }
}

// ---- rows --------------------------------------------------------------------------------------

/// Moments that tell rows and quantities apart.
TrainingModel numbered_model(std::size_t count) {
  Draws draws(7);
  Gaussians rows = random_gaussians(kTypical, count, random_camera(40, 30), 5);
  for (std::size_t i = 0; i < count; ++i) {
    rows.log_scale[i] = Vec3f(std::log(draws.log_uniform(0.02f, 2))) + draws.uniform3(-1, 0);
    rows.logit_opacity[i] = logit(draws.log_uniform(0.003f, 0.9f));
  }
  TrainingModel model = model_of(rows, MomentStorage::halves);
  number_moments(model, 1, 6'001);
  for (std::size_t i = 0; i < count; ++i) {
    model.statistics.visits[i] = float(draws.below(9));
    model.statistics.gradient_norm[i] = model.statistics.visits[i] * float(draws.below(32)) / 16;
  }
  return model;
}

TEST_F(CudaMoments, FollowTheirRowsAsOnTheScalarTwin) {
  constexpr AdaptiveRules kRules{.gradient_threshold = 1,
                                 .small_scale = 0.1f,
                                 .prune_opacity = 0.05f,
                                 .prune_scale = 1,
                                 .max_gaussians = 0};
  for (const std::size_t count : {0, 1, 257, 3000}) {
    SCOPED_TRACE(testing::Message() << " " << count);
    TrainingModel host = numbered_model(count);
    const auto change_both = [&](const char* what, const auto& change) {
      TrainingModel device = on_gpu(host);
      change(cpu().rows(), host);
      change(gpu().rows(), device);
      EXPECT_TRUE(same_bits(on_host(device).moments, host.moments)) << what;
    };
    change_both("grow", [&](RowOps& rows, TrainingModel& model) {
      rows.grow(model, GrowthRules{kRules}, 1, 600);
    });
    change_both("relocate", [&](RowOps& rows, TrainingModel& model) {
      rows.relocate(model, {0.1f, std::int64_t(count) + 100}, 1, 600);
    });
    change_both("prune", [](RowOps& rows, TrainingModel& model) { rows.prune(model, 0.1f); });
    for (const MomentClearing clears : {MomentClearing::opacity, MomentClearing::all})
      change_both("reset", [&](RowOps& rows, TrainingModel& model) {
        rows.lower_opacity(model, {OpacityPolicy::reset, 0.01f, clears});
      });
  }
}

TEST_F(CudaMoments, AreSortedWithTheirRows) {
  TrainingModel host = numbered_model(3000);
  TrainingModel device = on_gpu(host);
  cpu().rows().sort_by_morton(host);
  gpu().rows().sort_by_morton(device);
  EXPECT_TRUE(same_bits(on_host(device), host));
}

// ---- runs --------------------------------------------------------------------------------------

Config with_halves(Config config) {
  config.optimizer.moments = MomentStorage::halves;
  return config;
}

class CudaHalfRun : public CudaTest {
 protected:
  double mean_psnr(Config config) {
    constexpr int kSeeds = 6;
    double sum = 0;
    for (int seed = 1; seed <= kSeeds; ++seed) {
      config.train.seed = std::uint64_t(seed);
      Trainer trainer(scene_, config, gpu());
      trainer.run();
      sum += evaluate(gpu().renderer(), trainer.model().gaussians.span(), scene_.train_views,
                      trainer.evaluation_settings())
                 .psnr;
    }
    return sum / kSeeds;
  }
  TrainingModel trained(const Config& config) { return model_of_run(scene_, config, gpu()); }
  const Scene scene_ = small_scene();
};

// Rounding makes another run of it, as another seed does.
TEST_F(CudaHalfRun, EndsAsGoodAsWithFloats) {
  const double floats = mean_psnr(short_run());
  RecordProperty("psnr_of_floats", std::to_string(floats));
  const double halves = mean_psnr(with_halves(short_run()));
  RecordProperty("psnr_of_halves", std::to_string(halves));
  EXPECT_NEAR(halves, floats, 0.5);
}

TEST_F(CudaHalfRun, RepeatsItselfAndGoesOnWhereItWasStoppedInDeterministicSteps) {
  for (const int batch : {1, 3}) {
    SCOPED_TRACE(testing::Message() << ", batch " << batch);
    Config config = with_halves(busy_run());
    config.train.deterministic = true;
    config.train.batch = batch;
    const TrainingModel whole = trained(config);
    EXPECT_EQ(whole.moment_storage(), MomentStorage::halves);
    EXPECT_TRUE(same_bits(trained(config), whole));
    EXPECT_TRUE(same_bits(resumed_after(43, scene_, config, gpu()), whole));
  }
}

}  // namespace
}  // namespace gs
