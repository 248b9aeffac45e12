// SPDX-License-Identifier: Apache-2.0
// Gaussians in space and time become static: which ones do, that pictures stay nearly the same, what
// happens to static rows afterwards, and whole runs.
#include "gs_train/static_rows.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "gs_core/math/morton.h"
#include "gs_core/threads/parallel.h"
#include "gs_train/row_rules.h"
#include "tests/support/scene_run.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

constexpr double kAfter = 2;  // durations

/// A turn of space, tilted into time by `tilt`, that lives for `time_scale` durations.
SpacetimeShape<double> shape(double time_scale, double time_mean = 0.5, double tilt = 0) {
  const QuatPair<double> pair = turn_of_space(Quat<double>{0.8, 0.2, -0.4, 0.3});
  QuatPair<double> tilted = pair;
  tilted.right.x += tilt;
  return {{1, 2, 3}, {-3, -2, -4}, tilted, 0.7, time_mean, std::log(time_scale)};
}
bool becomes_static(const SpacetimeShape<double>& shape) {
  return static_gaussian(shape, kAfter).is_near;
}

TEST(StaticGaussian, LivesLongerThanTheRuleSays) {
  EXPECT_TRUE(becomes_static(shape(2.01)));
  EXPECT_FALSE(becomes_static(shape(1.99)));
}

TEST(StaticGaussian, NeedsALongerLifeTheFartherItsMeanIsFromTheMiddle) {
  EXPECT_FALSE(becomes_static(shape(3.99, 0)));
  EXPECT_TRUE(becomes_static(shape(4.01, 0)));
  EXPECT_TRUE(becomes_static(shape(4.01, 1)));
  EXPECT_FALSE(becomes_static(shape(4.01, 1.1)));
}

TEST(StaticGaussian, MovesLessThanAQuarterOfItsSize) {
  int moving = 0;
  for (const double tilt : {0.0, 1e-4, 1e-3, 1e-2, 0.1}) {
    const SpacetimeShape<double> tilted = shape(3, 0.5, tilt);
    const SpacetimeCovariance<double> S = covariance(tilted);
    const Vec3d v = velocity(S);
    const double way = std::sqrt(inner(v, v));
    const SymmetricEigen axes = symmetric_eigen(condition(S, 0.0).covariance);
    const double longest = std::sqrt(max_of(max_of(axes.value.x, axes.value.y), axes.value.z));
    if (way > 0.25 * longest) {
      EXPECT_FALSE(becomes_static(tilted)) << tilt;
      ++moving;
    }
    if (way < 0.25 * 0.1 * longest) {
      EXPECT_TRUE(becomes_static(tilted)) << tilt;
    }
  }
  EXPECT_GE(moving, 1);
}

TEST(StaticGaussian, IsNotMadeOfNumbersThatAreNotFinite) {
  const double infinity = std::numeric_limits<double>::infinity();
  for (const double bad : {infinity, -infinity, std::nan("")}) {
    SpacetimeShape<double> mean = shape(3), opacity = shape(3), scale = shape(3), time = shape(3),
                           life = shape(3);
    mean.mean.y = opacity.logit_opacity = scale.log_scale.x = time.time_mean = bad;
    life.log_time_scale = bad;
    for (const auto& broken : {mean, time, life}) EXPECT_FALSE(becomes_static(broken)) << bad;
    if (bad != -infinity) {
      EXPECT_FALSE(becomes_static(scale)) << bad;
    }
    EXPECT_FALSE(becomes_static(opacity)) << bad;
  }
}

/// Rows of which about half live long and stand nearly still.
TrainingModel mixed_model(const Camera& camera, std::size_t count, std::uint64_t seed) {
  TrainingModel model;
  model.gaussians = in_spacetime(random_gaussians(kTypical, count, camera, seed), seed);
  Draws draws(seed);
  for (std::size_t i = 0; i < count; i += 2) {
    const Quatf left = model.gaussians.rotation[i], right = mirrored(left),
                tilt = draws.quaternion();
    const float some = 1e-4f * std::sqrt(squared_norm(right));
    model.gaussians.right_rotation[i] = {right.w + some * tilt.w, right.x + some * tilt.x,
                                         right.y + some * tilt.y, right.z + some * tilt.z};
    model.gaussians.log_time_scale[i] = std::log(draws.uniform(4, 6));
  }
  clear_history(model);
  const auto fill = [](const Gaussians& moments) {
    for_each_array(
        [](const char*, auto& array) {
          float* const numbers = reinterpret_cast<float*>(array.data());
          std::fill(numbers, numbers + array.size() * sizeof(*array.data()) / sizeof(float), 0.5f);
        },
        moments);
  };
  fill(model.first_moment);
  fill(model.second_moment);
  return model;
}

std::vector<float> picture_of(const Gaussians& gaussians, const Camera& camera) {
  RenderPass pass;
  make_scalar_renderer()->forward(gaussians.span(), camera, {}, pass);
  return image_of(pass).pixels;
}
double mean_difference(const std::vector<float>& a, const std::vector<float>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += std::abs(a[i] - b[i]);
  return sum / double(a.size());
}

TEST(MakeStatic, KeepsPicturesNearlyTheSameAtEveryTime) {
  Camera camera = random_camera(96, 64, 3);
  TrainingModel model = mixed_model(camera, 300, 5);
  const Gaussians before = copy_of(model.gaussians);
  const std::size_t made = make_scalar_row_ops()->make_static(model, kAfter);
  EXPECT_GT(made, 100u);
  EXPECT_LE(made, 150u);
  EXPECT_EQ(static_count(model.gaussians), made);
  for (const float time : {0.0f, 0.25f, 0.5f, 0.75f, 1.0f}) {
    camera.time = time;
    const std::vector<float> picture = picture_of(before, camera);
    EXPECT_LT(mean_difference(picture_of(model.gaussians, camera), picture), 4e-3) << time;
    Gaussians unmarked = copy_of(model.gaussians);  // by the numbers alone
    for (float& value : unmarked.log_time_scale)
      if (is_static(value)) value = std::nextafter(value, 5.0f);
    EXPECT_LT(mean_difference(picture_of(unmarked, camera), picture_of(model.gaussians, camera)),
              1e-4)
        << time;
  }
}

TEST(MakeStatic, NeedsAColorThatHardlyChangesAndTakesThatOfTheMiddle) {
  Camera camera = random_camera(96, 64, 3);
  TrainingModel model = mixed_model(camera, 300, 5);
  const std::size_t without = [&] {
    TrainingModel same = copy_to(host_memory(), model);
    return make_scalar_row_ops()->make_static(same, kAfter);
  }();
  model.gaussians = with_slopes(model.gaussians, 4);
  for (std::size_t i = 0; i < model.count(); ++i)  // of those that live long, half change little
    model.gaussians.sh0_slope[i] = Vec3f(i % 4 == 0 ? 0.1f : 2.0f);
  clear_history(model);
  const Gaussians before = copy_of(model.gaussians);
  const std::size_t made = make_scalar_row_ops()->make_static(model, kAfter);
  EXPECT_LT(made, without);
  EXPECT_GT(made, 50u);
  for (std::size_t i = 0; i < model.count(); ++i) {
    const bool is = is_static(model.gaussians.log_time_scale[i]);
    if (is) {
      EXPECT_EQ(i % 4, 0u);
      EXPECT_EQ(model.gaussians.sh0_slope[i], Vec3f(0.0f));
    }
    const float u = phase_at(spacetime_shape_of(before.span(), i), 0.5f);
    const Vec3f expected =
        is ? sh0_at(before.sh0[i], before.sh0_slope[i], u) : Vec3f(before.sh0[i]);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(model.gaussians.sh0[i][c], expected[c], 1e-5f);
  }
}

TEST(MakeStatic, ClearsTheMomentsOfShapeAndTimeAndLeavesOtherRowsAlone) {
  TrainingModel model = mixed_model(random_camera(96, 64, 3), 100, 6);
  const TrainingModel before = copy_to(host_memory(), model);
  ASSERT_GT(make_scalar_row_ops()->make_static(model, kAfter), 20u);
  for (std::size_t i = 0; i < model.count(); ++i) {
    if (!is_static(model.gaussians.log_time_scale[i])) {
      EXPECT_EQ(model.gaussians.mean[i], before.gaussians.mean[i]);
      EXPECT_EQ(model.gaussians.log_time_scale[i], before.gaussians.log_time_scale[i]);
      EXPECT_EQ(model.first_moment.time_mean[i], 0.5f);
      continue;
    }
    for (const Gaussians* moment : {&model.first_moment, &model.second_moment}) {
      EXPECT_EQ(moment->log_scale[i], Vec3f(0.0f));
      EXPECT_EQ(squared_norm(moment->rotation[i]) + squared_norm(moment->right_rotation[i]), 0);
      EXPECT_EQ(moment->time_mean[i], 0);
      EXPECT_EQ(moment->log_time_scale[i], 0);
      EXPECT_EQ(moment->mean[i], Vec3f(0.5f));
      EXPECT_EQ(moment->sh0[i], Vec3f(0.5f));
    }
  }
  EXPECT_EQ(make_scalar_row_ops()->make_static(model, kAfter), 0u);  // once is enough
}

TEST(MakeStatic, ClearsCodesOfTheSameQuantities) {
  TrainingModel model = mixed_model(random_camera(96, 64, 3), 100, 6);
  model.moment_form = MomentForm::tiny;
  clear_history(model);
  number_codes(model, 1);
  const TrainingModel before = copy_to(host_memory(), model);
  ASSERT_GT(make_scalar_row_ops()->make_static(model, kAfter), 20u);
  const MomentCodes &codes = model.codes, &old = before.codes;
  for (std::size_t i = 0; i < model.count(); ++i) {
    const auto number = std::uint32_t(i + 1);
    const std::uint32_t expected = is_static(model.gaussians.log_time_scale[i]) ? 0 : number;
    EXPECT_TRUE(codes_are(codes.log_scale, i, expected) && codes_are(codes.rotation, i, expected) &&
                codes_are(codes.right_rotation, i, expected) &&
                codes_are(codes.time_mean, i, expected) &&
                codes_are(codes.log_time_scale, i, expected))
        << i;
    EXPECT_TRUE(codes_are(codes.mean, i, number) && codes_are(codes.logit_opacity, i, number)) << i;
  }
  EXPECT_TRUE(same_bits(codes.sh_rest, old.sh_rest));
}

TEST(MakeStatic, DoesNothingToRowsWithoutTime) {
  TrainingModel model;
  model.gaussians = random_gaussians(kTypical, 20, random_camera(96, 64, 3), 1);
  clear_history(model);
  EXPECT_EQ(make_scalar_row_ops()->make_static(model, kAfter), 0u);
}

TEST(StaticRows, SplitAsIn3D) {
  Gaussians rows(1, host_memory(), true);
  set_gaussian(rows, 0, {1, 2, 3}, 0.1f, 0.5f);
  rows.log_scale[0] = {-1, -2, -3};
  rows.rotation[0] = {0.8f, 0.2f, -0.4f, 0.3f};
  make_half_static(rows);
  Gaussians still(1, host_memory());
  still.mean[0] = rows.mean[0];
  still.log_scale[0] = rows.log_scale[0];
  still.rotation[0] = static_rotation(rows.rotation[0]);
  const Random random{1, RandomStream::split_gaussians};
  const HalfRow half = half_of(rows.span(), 0, 3, random, 7);
  const HalfRow expected = half_of(still.span(), 0, 3, random, 7);
  EXPECT_EQ(half.mean, expected.mean);
  EXPECT_EQ(half.log_scale, expected.log_scale);
  EXPECT_EQ(half.time_mean, 0.5f);
  EXPECT_TRUE(is_static(half.log_time_scale));
}

TEST(StaticRows, ComeLastInTheOrderOfMemory) {
  const std::uint64_t far = (std::uint64_t(1) << 63) - 1;
  EXPECT_GT(spacetime_code(0, 0, kStaticLogTimeScale), spacetime_code(far, 1, -1));
  const TrainingModel model = mixed_model(random_camera(96, 64, 3), 200, 7);
  make_half_static(model.gaussians);
  const Gaussians& rows = model.gaussians;
  const std::vector<std::uint32_t> order =
      morton_order(rows.mean.span(), rows.time_mean.span(), rows.log_time_scale.span()).download();
  for (std::size_t k = 0; k < order.size(); ++k)
    EXPECT_EQ(is_static(rows.log_time_scale[order[k]]), k >= order.size() / 2);
}

Scene timed_scene() {
  Scene scene = small_scene();
  const std::size_t count = scene.train_views.size();
  for (std::size_t i = 0; i < count; ++i)
    scene.train_views[i].camera.time = float(i) / float(count - 1);
  scene.time_count = count;
  return scene;
}

/// Nothing moves, so that a low threshold costs nothing. Splits shorten lives again and again.
Config static_run() {
  Config config = short_run();
  config.model.dynamic = true;
  config.model.initial_time_scale = 1;
  config.train.iterations = 200;
  config.density.from_step = config.density.every = 20;
  config.density.gradient_threshold = 1e-5f;
  config.density.static_after = 0.3f;
  config.density.time_scale_regularizer = 1e-4f;
  config.density.velocity_regularizer = 1e-4f;
  config.train.checkpoint_every = 10;
  config.train.morton_every = 1000;
  return config;
}
Config static_mcmc_run() {
  Config config = static_run();
  config.density.strategy = "mcmc";
  config.density.max_gaussians = 80;
  config.density.growth = 0.2f;
  return config;
}
Config static_budgeted_run(SplitPlacement split) {
  Config config = static_run();
  config.density.strategy = "budgeted";
  config.density.split = split;
  return config;
}
Config static_run_with(MomentForm form) {
  Config config = static_run();
  config.optimizer.moments = form;
  return config;
}
std::vector<Config> static_runs() {
  return {static_run(), static_mcmc_run(), static_run_with(MomentForm::tiny),
          static_budgeted_run(SplitPlacement::draw), static_budgeted_run(SplitPlacement::axis)};
}

class StaticRun : public SceneRun {
 protected:
  StaticRun() : SceneRun(timed_scene()) {}
};

TEST_F(StaticRun, LeavesEveryStaticRowATurnOfSpaceToTheLastBit) {
  for (const Config& config : static_runs()) {
    const TrainingModel model = trained(config);
    EXPECT_GT(static_count(model.gaussians), model.count() / 10) << config.density.strategy;
    for (std::size_t i = 0; i < model.count(); ++i) {
      if (!is_static(model.gaussians.log_time_scale[i])) continue;
      const Quatf expected = mirrored(model.gaussians.rotation[i]),
                  right = model.gaussians.right_rotation[i];
      EXPECT_TRUE(right.w == expected.w && right.x == expected.x && right.y == expected.y &&
                  right.z == expected.z)
          << i;
      EXPECT_EQ(model.gaussians.time_mean[i], 0.5f);
    }
  }
}

TEST_F(StaticRun, LearnsWhatStandsStillAsWell) {
  Config config = static_run();
  const double psnr = psnr_after(config);
  config.density.static_after = 0;
  EXPECT_GT(psnr, psnr_after(config) - 0.5);
}

TEST_F(StaticRun, GivesTheSameBitsForAnyNumberOfThreads) {
  set_thread_count(1);
  const TrainingModel one = trained(static_run());
  set_thread_count(0);
  EXPECT_TRUE(same_bits(trained(static_run()), one));
}

TEST_F(StaticRun, StoppedAndResumedEndsWithTheSameBits) {
  for (const Config& config : static_runs()) expect_goes_on_after({63, 150}, config);
}

TEST_F(StaticRun, WithARuleThatNoRowMeetsIsThatWithoutTheRule) {
  Config config = static_run();
  config.density.static_after = 1e6f;
  const TrainingModel expected = trained(config);
  config.density.static_after = 0;
  const TrainingModel model = trained(config);
  EXPECT_EQ(static_count(model.gaussians), 0u);
  EXPECT_TRUE(same_bits(model, expected));
}

}  // namespace
}  // namespace gs
