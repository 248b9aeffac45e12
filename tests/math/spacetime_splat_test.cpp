// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/density/spacetime_regularizer.h"

#include "gs_core/camera.h"
#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

constexpr std::size_t kShRest = kShBasisCount - 1;
constexpr std::size_t kParameters = 65;
constexpr double kTime = 0.4;

/// The parameters in one flat array: those of the Gaussian in space, then of time.
template <class T>
struct FlatGaussian {
  std::array<Vec3<T>, kShRest> sh_rest;
  SpacetimeParameters<T> parameters;
  explicit FlatGaussian(const std::array<T, kParameters>& flat) {
    Unflatten in(flat);
    parameters.space = {in.vec3(), in.vec3(), in.quat(), in.scalar(), in.vec3(), sh_rest.data()};
    sh_rest = in.template vec3s<kShRest>();
    parameters.right_rotation = in.quat();
    parameters.time_mean = in.scalar();
    parameters.log_time_scale = in.scalar();
  }
  FlatGaussian(const FlatGaussian&) = delete;  // `parameters` points into it
};

template <class T>
PinholeCamera<T> camera_of() {
  PinholeCamera<T> camera;
  camera.width = 64;
  camera.height = 48;
  camera.fx = T(50);
  camera.fy = T(45);
  camera.cx = T(32);
  camera.cy = T(24);
  camera.cam_from_world_rotation = {
      {T(0.8), T(0), T(0.6)}, {T(0), T(1), T(0)}, {T(-0.6), T(0), T(0.8)}};
  camera.cam_from_world_translation = {T(0.3), T(-0.2), T(0.5)};
  return camera;
}

/// In view and alive at kTime. The mean in space is where the Gaussian is at its mean in time.
std::array<double, kParameters> draw_gaussian(TestRandom& random) {
  const PinholeCamera<double> camera = camera_of<double>();
  for (;;) {
    const Vec3d p{random.uniform(-1.0, 1.0), random.uniform(-0.8, 0.8), random.uniform(2.0, 5.0)};
    std::array<Vec3d, kShRest> sh_rest;
    for (Vec3d& c : sh_rest) c = random.uniform3(-0.5, 0.5);
    const Vec3d mean =
        multiply_transposed(camera.cam_from_world_rotation, p - camera.cam_from_world_translation);
    const auto x =
        flatten(mean, random.uniform3(-3.5, -1.5), random.quaternion(), random.uniform(-1.0, 5.0),
                random.uniform3(-2.0, 2.0), sh_rest, random.quaternion(),
                kTime + random.uniform(-0.3, 0.3), random.uniform(-2.0, 0.0));
    const FlatGaussian<double> g(x);
    if (project_gaussian(camera, g.parameters, kTime, {}).is_visible) return x;
  }
}

/// The worst gradient by any parameter against Jets.
double worst_error(const SplatSettings& settings) {
  const auto camera = camera_of<double>();
  return worst_gradient_error(
      [&](const auto& x) {
        using T = std::decay_t<decltype(x[0])>;
        const FlatGaussian<T> g(x);
        const auto splat = project_gaussian(camera_of<T>(), g.parameters, T(kTime), settings).splat;
        return flatten(splat.mean2d, splat.conic, splat.opacity, splat.color);
      },
      [&](const auto& x, const auto& dL) {
        const FlatGaussian<double> g(x);
        std::array<Vec3d, kShRest> dL_drest{};
        const auto dL_dx = project_gaussian_vjp(camera, g.parameters, kTime, settings,
                                                splat_gradient(dL), dL_drest.data());
        const SpacetimeShape<double>& by = dL_dx.shape;
        return flatten(by.mean, by.log_scale, by.rotations.left, by.logit_opacity, dL_dx.sh0,
                       dL_drest, by.rotations.right, by.time_mean, by.log_time_scale);
      },
      draw_gaussian);
}

TEST(ProjectAtATime, GradientByEveryParameterMatchesJetForEveryDegree) {
  for (int degree = 0; degree <= 3; ++degree)
    EXPECT_LT(worst_error({.sh_degree = degree}), kJetTolerance) << "degree " << degree;
}

TEST(ProjectAtATime, GradientThroughTheAntialiasFactorMatchesJet) {
  EXPECT_LT(worst_error({.antialias = true, .antialias_detach = false}), kJetTolerance);
}

TEST(SpacetimeRegularizer, GradientMatchesJet) {
  const Regularizers of_each{0, 0, 0.3f, 0.7f};
  const double worst = worst_gradient_error(
      [&](const auto& x) {
        using T = std::decay_t<decltype(x[0])>;
        const FlatGaussian<T> g(x);
        return std::array<T, 1>{spacetime_regularizer(shape_of(g.parameters), of_each)};
      },
      [&](const auto& x, const auto& dL) {
        const FlatGaussian<double> g(x);
        SpacetimeShape<double> by{Vec3d(0.0), Vec3d(0.0), {{}, {}}, 0, 0, 0};
        add_spacetime_regularizer_vjp(shape_of(g.parameters), of_each, by);
        std::array<double, kParameters> all = flatten(
            by.mean, by.log_scale, by.rotations.left, by.logit_opacity, Vec3d(0.0),
            std::array<Vec3d, kShRest>{}, by.rotations.right, by.time_mean, by.log_time_scale);
        for (double& number : all) number *= dL[0];
        return all;
      },
      draw_gaussian);
  EXPECT_LT(worst, kJetTolerance);
}

TEST(IsFarInTime, IsOnlyWhatIsInvisible) {
  TestRandom random;
  int far = 0, invisible = 0;
  for (int k = 0; k < 20000; ++k) {
    const SpacetimeShape<float> shape{Vec3f(random.uniform3(-1, 1)),
                                      Vec3f(random.uniform3(-4, 0)),
                                      {random.float_quaternion(), random.float_quaternion()},
                                      3.0f,
                                      float(random.uniform(-1, 2)),
                                      float(random.uniform(-4, 0))};
    const float time = float(random.uniform(0, 1));
    const Instant<float> moment = condition(covariance(shape), time - shape.time_mean);
    invisible += !is_alive(moment.marginal);
    if (!is_far_in_time(shape.log_scale, shape.time_mean, shape.log_time_scale, time)) continue;
    ++far;
    EXPECT_FALSE(is_alive(moment.marginal));
  }
  EXPECT_GT(far, invisible / 3);
}

// Regularizers and photos push the scale in time of what stands still up without an end.
TEST(ProjectAtATime, LifeLongerThanTheLongestChangesNothingAndHasNoGradient) {
  TestRandom random;
  const auto camera = camera_of<float>();
  const auto flat = draw_gaussian(random);
  std::array<float, kParameters> x;
  std::copy(flat.begin(), flat.end(), x.begin());
  const auto splat_at = [&](float log_time_scale) {
    FlatGaussian<float> g(x);
    g.parameters.log_time_scale = log_time_scale;
    const auto splat = project_gaussian(camera, g.parameters, float(kTime), {}).splat;
    return flatten(splat.mean2d, splat.conic, splat.opacity, splat.color);
  };
  const auto longest = splat_at(kMaxLogTimeScale);
  for (const float number : longest) EXPECT_TRUE(std::isfinite(number));
  EXPECT_NE(longest, splat_at(kMaxLogTimeScale - 0.5f));
  for (const float more : {0.1f, 10.0f, 1e30f})
    EXPECT_EQ(splat_at(kMaxLogTimeScale + more), longest);

  FlatGaussian<double> g(flat);
  const Regularizers of_each{0, 0, 0.3f, 0.7f};
  for (const double more : {-0.5, 0.1}) {
    g.parameters.log_time_scale = kMaxLogTimeScale + more;
    const SpacetimeShape<double> shape = shape_of(g.parameters);
    SpacetimeShape<double> by =
        project_shape_vjp(camera_of<double>(), shape, kTime, {},
                          BasicSplatGradient<double>{{1, 2}, {1, 2, 3}, 4, Vec3d(0.0)}, Vec3d(0.0));
    add_spacetime_regularizer_vjp(shape, of_each, by);
    EXPECT_EQ(by.log_time_scale == 0, more > 0) << more;
    EXPECT_NE(by.mean.x, 0);
  }
}

// Regularizers act on every row, also on those that no photo shows.
TEST(SpacetimeRegularizer, OfAnyShapeHasFiniteGradients) {
  TestRandom random;
  for (int k = 0; k < 2000; ++k) {
    const SpacetimeShape<float> shape{
        Vec3f(0.0f),
        Vec3f(random.uniform3(-40, 3)),
        {random.float_quaternion(), k % 3 ? random.float_quaternion() : Quatf{1, 0, 0, 0}},
        0.0f,
        0.0f,
        float(random.uniform(-40, 40))};
    SpacetimeShape<float> by{Vec3f(0.0f), Vec3f(0.0f), {{}, {}}, 0, 0, 0};
    add_spacetime_regularizer_vjp(shape, {0, 0, 1e-4f, 1e-4f}, by);
    for (const float number :
         flatten(by.log_scale, by.rotations.left, by.rotations.right, by.log_time_scale))
      ASSERT_TRUE(std::isfinite(number)) << k;
  }
}

// A pair of quaternions that turns space alone, and a mean in time that is now: the Gaussian of
// rotation.h and splat.h, to the last digits.
TEST(ProjectAtATime, OfAGaussianThatStandsIsThatOfItsEllipsoid) {
  TestRandom random;
  for (int i = 0; i < 200; ++i) {
    const auto x = draw_gaussian(random);
    FlatGaussian<double> g(x);
    g.parameters.space.rotation = g.parameters.right_rotation = {1, 0, 0, 0};
    g.parameters.time_mean = kTime;
    const auto moving = project_gaussian(camera_of<double>(), g.parameters, kTime, {});
    const auto still = project_gaussian(camera_of<double>(), g.parameters.space, {});
    ASSERT_EQ(moving.is_visible, still.is_visible);
    EXPECT_EQ(moving.depth, still.depth);
    EXPECT_EQ(
        flatten(moving.splat.mean2d, moving.splat.conic, moving.splat.opacity, moving.splat.color),
        flatten(still.splat.mean2d, still.splat.conic, still.splat.opacity, still.splat.color));
  }
}

TEST(ProjectAtATime, IsInvisibleOutsideItsTime) {
  TestRandom random;
  FlatGaussian<double> g(draw_gaussian(random));
  g.parameters.space.rotation = g.parameters.right_rotation = {1, 0, 0, 0};
  g.parameters.time_mean = kTime;
  const double sigma = std::exp(g.parameters.log_time_scale);
  const auto is_visible_after = [&](double sigmas) {
    return project_gaussian(camera_of<double>(), g.parameters, kTime + sigmas * sigma, {})
        .is_visible;
  };
  EXPECT_TRUE(is_visible_after(2.4));   // exp(-2.4^2 / 2) = 0.056
  EXPECT_FALSE(is_visible_after(2.5));  // 0.044
  EXPECT_FALSE(is_visible_after(-2.5));
}

}  // namespace
}  // namespace gs
