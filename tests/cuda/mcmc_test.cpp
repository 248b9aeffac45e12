// SPDX-License-Identifier: Apache-2.0
// The MCMC strategy and absolute gradients on the GPU: draws, copies, noise and steps are those of
// the scalar twin.
#include "tests/support/cuda.h"

namespace gs {
namespace {

constexpr int kStep = 700;
constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Rows of all opacities, including dead ones, and some with broken values. The last SH coefficient
/// holds the number of the row, and the moments that number and more.
TrainingModel random_model(std::size_t count, std::uint64_t seed) {
  Draws draws(seed);
  const Gaussians rows = random_gaussians(kTypical, count, random_camera(40, 30), seed);
  for (std::size_t i = 0; i < count; ++i) {
    rows.logit_opacity[i] = logit(draws.log_uniform(0.001f, 0.999f));
    rows.sh_rest[i].coefficient[kShRestCount - 1].z = float(i);
    if (draws.chance(0.02f)) rows.mean[i].x = kInfinity;
    if (draws.chance(0.02f)) rows.rotation[i] = {0, 0, 0, 0};
    if (draws.chance(0.02f)) rows.logit_opacity[i] = std::numeric_limits<float>::quiet_NaN();
  }
  TrainingModel model = model_of(rows);
  number_moments(model, 1, 1);
  number_rows(model.statistics.visits, 20.5f);
  return model;
}

class CudaMcmc : public CudaTest {
 protected:
  /// Relocates the same model on both backends and expects the same rows. Opacities and scales of
  /// rows that share may differ in their last bit, because they are computed in double and rounded
  /// to float.
  RefineReport relocate_both(TrainingModel model, std::int64_t grow_to, std::uint64_t seed = 1,
                             const Region& region = {}) {
    TrainingModel device = on_gpu(model);
    const RelocationRules rules{0.005f, grow_to, region};
    const RefineReport expected = cpu().rows().relocate(model, rules, seed, kStep);
    const RefineReport actual = gpu().rows().relocate(device, rules, seed, kStep);
    EXPECT_EQ(actual.moved, expected.moved);
    EXPECT_EQ(actual.cloned, expected.cloned);
    const TrainingModel result = on_host(device);
    EXPECT_EQ(result.count(), model.count());
    if (result.count() != model.count()) return expected;
    EXPECT_TRUE(same_bits(result.gaussians.mean, model.gaussians.mean));
    EXPECT_TRUE(same_bits(result.gaussians.rotation, model.gaussians.rotation));
    EXPECT_TRUE(same_bits(result.gaussians.sh0, model.gaussians.sh0));
    EXPECT_TRUE(same_bits(result.gaussians.sh_rest, model.gaussians.sh_rest));
    EXPECT_TRUE(same_bits(result.moments, model.moments));
    EXPECT_TRUE(same_bits(result.statistics.visits, model.statistics.visits));
    EXPECT_TRUE(same_bits(result.statistics.gradient_norm, model.statistics.gradient_norm));
    for (std::size_t i = 0; i < model.count(); ++i) {
      const float wanted = model.gaussians.logit_opacity[i];
      if (std::isnan(wanted)) continue;
      EXPECT_NEAR(result.gaussians.logit_opacity[i], wanted,
                  2e-6f * std::max(1.0f, std::abs(wanted)))
          << i;
      for (int axis = 0; axis < 3; ++axis)
        EXPECT_NEAR(result.gaussians.log_scale[i][axis], model.gaussians.log_scale[i][axis], 4e-6f)
            << i;
    }
    return expected;
  }

  /// Takes steps with everything that density control may ask for, on both backends.
  void expect_same_steps(const RenderSettings& settings, const DensityStep& asked,
                         const LearningRates& rates) {
    View view;
    view.camera = random_camera(131, 77, 1);
    view.photo = random_photo(131, 77, 3);
    TrainingModel expected = model_of(random_gaussians(kTypical, 3000, view.camera, 5));
    TrainingModel actual = on_gpu(expected);
    for (int step = 1; step <= 3; ++step) {
      DensityStep density = asked;
      density.noise.step = step;
      cpu().step(expected, view, settings, {0.2f}, rates, density);
      gpu().step(actual, view, settings, {0.2f}, rates, density);
    }
    gpu().synchronize(actual);
    const auto compare = [](const char* name, const auto& a, const auto& b) {
      EXPECT_LT(norm_difference(downloaded(a), downloaded(b)), 1e-2) << name;
    };
    for_each_array(compare, actual.gaussians, expected.gaussians);
    for_each_array(compare, opened(actual).first, opened(expected).first);
    compare("gradient_norm", actual.statistics.gradient_norm, expected.statistics.gradient_norm);
    compare("visits", actual.statistics.visits, expected.statistics.visits);
  }
};

TEST_F(CudaMcmc, RelocatesTheSameRows) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const RefineReport report = relocate_both(random_model(3000, seed), 3150, seed);
    EXPECT_GT(report.moved, 300u);
    EXPECT_EQ(report.cloned, 150u);
  }
}

TEST_F(CudaMcmc, RelocatesTheSameRowsOfARegion) {
  Region region;
  region.half_spaces[0] = {{0, 1, 0}, 0};
  region.count = 1;
  EXPECT_GT(relocate_both(random_model(3000, 4), 3150, 4, region).moved, 300u);
}

TEST_F(CudaMcmc, RelocatesAnyNumberOfRows) {
  for (const std::size_t count : {0, 1, 2, 31, 255, 256, 257, 513}) {
    SCOPED_TRACE(std::to_string(count) + " rows");
    relocate_both(random_model(count, 5), std::int64_t(count) + 3);
    relocate_both(random_model(count, 6), 0);
  }
}

TEST_F(CudaMcmc, SharesOneRowAmongThousands) {
  TrainingModel model = random_model(5000, 7);
  std::fill(model.gaussians.logit_opacity.begin(), model.gaussians.logit_opacity.end(), -9.0f);
  model.gaussians.logit_opacity[1234] = 3.0f;
  model.gaussians.mean[1234] = Vec3f(1.0f);
  model.gaussians.rotation[1234] = {1, 0, 0, 0};
  EXPECT_EQ(relocate_both(std::move(model), 0).moved, 4999u);
}

TEST_F(CudaMcmc, WithoutALiveRowDoesNothing) {
  TrainingModel model = random_model(100, 8);
  std::fill(model.gaussians.logit_opacity.begin(), model.gaussians.logit_opacity.end(), -9.0f);
  const RefineReport report = relocate_both(std::move(model), 200);
  EXPECT_EQ(report.moved + report.cloned, 0u);
}

TEST_F(CudaMcmc, RelocatesTheSameRowsTwice) {
  TrainingModel a = on_gpu(random_model(3000, 9)), b = on_gpu(random_model(3000, 9));
  for (TrainingModel* model : {&a, &b}) gpu().rows().relocate(*model, {0.005f, 3150}, 1, kStep);
  EXPECT_TRUE(same_bits(on_host(a), on_host(b)));
}

// Rows behind the camera have no gradient, so that a step moves them by the noise alone.
TEST_F(CudaMcmc, AddsTheSameNoise) {
  const Gaussians rows = random_gaussians(kTypical, 2000, random_camera(40, 30), 10);
  for (float& value : rows.logit_opacity) value -= 4;
  TrainingModel host = model_of(rows);
  std::fill(host.gaussians.mean.begin(), host.gaussians.mean.end(), Vec3f(0.0f));
  TrainingModel device = on_gpu(host);
  View view;
  view.camera = random_camera(40, 30);
  view.camera.cam_from_world_translation = {0, 0, -1e3f};
  view.photo = random_photo(40, 30, 3);
  const DensityStep density{.noise = {5e5f, {1, RandomStream::position_noise}, kStep}};
  LearningRates rates{};
  rates.mean = 1e-4f;
  cpu().step(host, view, {}, {0.2f}, rates, density);
  gpu().step(device, view, {}, {0.2f}, rates, density);
  gpu().synchronize(device);
  EXPECT_LT(relative_difference(downloaded(device.gaussians.mean), downloaded(host.gaussians.mean)),
            1e-5);
}

TEST_F(CudaMcmc, StepsWithRegularizersAndNoiseAreTheScalarOnes) {
  DensityStep density{.regularizers = {0.5f, 0.5f},
                      .noise = {1e3f, {1, RandomStream::position_noise}, 0}};
  for (const int degree : {0, 1, 2, 3}) {
    SCOPED_TRACE(degree);
    RenderSettings settings;
    settings.sh_degree = degree;
    expect_same_steps(settings, density, kRates);
  }
}

// The rates are zero, because Adam's first steps would turn the sign of a tiny gradient into a
// whole step.
TEST_F(CudaMcmc, StatisticsOfAbsoluteGradientsAreTheScalarOnes) {
  LearningRates still = kRates;
  for_each_array([](const char*, float& rate) { rate = 0; }, still);
  for (const BlendRule rule : {BlendRule::faster_gs, BlendRule::classic}) {
    RenderSettings settings;
    settings.absolute_gradient = true;
    settings.blend_rule = rule;
    expect_same_steps(settings, {.gather_statistics = true}, still);
    expect_same_steps(settings, {.gather_statistics = true, .regularizers = {0.5f, 0.5f}}, still);
  }
}

TEST_F(CudaMcmc, AbsoluteGradientsLeaveThoseOfTheParametersAlone) {
  const Camera camera = random_camera(131, 77, 1);
  const Gaussians gaussians = random_gaussians(kTypical, 3000, camera, 11);
  const TrainingModel device = on_gpu(model_of(gaussians));
  Buffer<float> dL_dimage(gpu().memory());
  std::vector<float> weights(3 * 131 * 77);
  Draws draws(12);
  for (float& weight : weights) weight = draws.uniform(-1, 1);
  dL_dimage.upload(weights);
  const auto gradients_of = [&](bool is_absolute, Buffer<Vec2f>& by_mean2d) {
    RenderSettings settings;
    settings.absolute_gradient = is_absolute;
    RenderPass pass(gpu().memory());
    Gaussians gradients(gaussians.count(), gpu().memory());
    by_mean2d.resize(gaussians.count());
    gpu().renderer().forward(device.gaussians.span(), camera, settings, pass);
    gpu().renderer().backward(device.gaussians.span(), camera, settings, pass, dL_dimage.span(),
                              gradients.span(), by_mean2d.span());
    return downloaded(gradients.mean);
  };
  Buffer<Vec2f> plain(gpu().memory()), absolute(gpu().memory());
  const std::vector<float> expected = gradients_of(false, plain);
  EXPECT_LT(norm_difference(gradients_of(true, absolute), expected),
            1e-4);  // atomic additions have no fixed order
  const std::vector<float> a = downloaded(absolute), p = downloaded(plain);
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_GE(a[i], std::abs(p[i]) * 0.99f - 1e-4f) << i;
}

TEST_F(CudaMcmc, ReplacesGivenRowsAsTheScalarTwin) {
  TrainingModel host = random_model(1000, 3), device = on_gpu(host);
  std::vector<std::uint32_t> dead, source;
  for (std::uint32_t i = 0; i < 300; ++i) dead.push_back(3 * i), source.push_back(3 * (i % 50) + 1);
  const Span<const std::uint32_t> to{dead.data(), dead.size()}, from{source.data(), source.size()};
  cpu().rows().replace(host, to, from, 0.005f);
  gpu().rows().replace(device, to, from, 0.005f);
  const TrainingModel actual = on_host(device);
  EXPECT_TRUE(same_bits(actual.gaussians.mean, host.gaussians.mean));
  EXPECT_TRUE(same_bits(actual.gaussians.sh_rest, host.gaussians.sh_rest));
  EXPECT_TRUE(same_bits(actual.moments, host.moments));
  for (std::size_t i = 0; i < host.count(); ++i)
    if (const float wanted = host.gaussians.logit_opacity[i]; std::isfinite(wanted))
      EXPECT_NEAR(actual.gaussians.logit_opacity[i], wanted,
                  2e-6f * std::max(1.0f, std::abs(wanted)));
}

TEST_F(CudaMcmc, MemorySaysHowMuchIsFree) {
  EXPECT_GT(gpu().memory().free_bytes(), std::size_t(1) << 26);
}

}  // namespace
}  // namespace gs
