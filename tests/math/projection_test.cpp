// SPDX-License-Identifier: Apache-2.0
// Stage 1 from world space to the image plane: each formula, then the chain of all of them for one
// Gaussian (splat.h).
#include "gs_core/math/render/projection.h"

#include "gs_core/math/render/rotation.h"
#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

/// A posed camera with an off-center principal point, whose picture and pixels are not square.
PinholeCamera<double> draw_camera(TestRandom& random) {
  const double width = 640.0, height = 420.0;
  return {640,
          420,
          random.uniform(300.0, 900.0),
          random.uniform(300.0, 900.0),
          width * random.uniform(0.3, 0.7),
          height * random.uniform(0.3, 0.7),
          rotation_matrix(random.quaternion()),
          random.uniform3(-2.0, 2.0)};
}

/// Inside and beyond each of the four frustum limits.
struct FrustumVisits {
  int left = 0, right = 0, above = 0, below = 0, inside = 0;
  void add(const PinholeCamera<double>& camera, const Vec3d& p) {
    const FrustumLimits<double> limits = frustum_limits(camera);
    const double x = p.x / p.z, y = p.y / p.z;
    left += x < limits.low.x;
    right += x > limits.high.x;
    above += y < limits.low.y;
    below += y > limits.high.y;
    inside += x > limits.low.x && x < limits.high.x && y > limits.low.y && y < limits.high.y;
  }
  int fewest() const { return std::min({left, right, above, below, inside}); }
};

/// A point in camera space: inside the frustum, or beyond one or two of its limits.
Vec3d draw_point(TestRandom& random) {
  const double z = random.uniform(0.3, 8.0);
  return {z * random.uniform(-1.8, 1.8), z * random.uniform(-1.8, 1.8), z};
}

/// A covariance with standard deviations of 0.3 to 30 pixels.
Sym2<double> draw_covariance2d(TestRandom& random) {
  const double a = std::pow(10.0, random.uniform(-1.0, 3.0)),
               b = std::pow(10.0, random.uniform(-1.0, 3.0));
  const double angle = random.uniform(0.0, 3.2), c = std::cos(angle), s = std::sin(angle);
  return {a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c};
}

TEST(ToCamera, TakesTheCameraCenterToTheOrigin) {
  TestRandom random;
  const PinholeCamera<double> camera = draw_camera(random);
  const Vec3d origin = to_camera(camera, camera.position());
  EXPECT_NEAR(inner(origin, origin), 0.0, 1e-28);
}

// Half a unit right and a quarter unit up, two units ahead: 100/4 right and 200/8 up of the center.
TEST(ProjectMean, IsTheHandValue) {
  const PinholeCamera<double> camera{64, 48, 100.0, 200.0, 30.0, 20.0};
  const Vec2<double> mean2d = project_mean(camera, Vec3d{0.5, -0.25, 2.0});
  EXPECT_DOUBLE_EQ(mean2d.x, 55.0);
  EXPECT_DOUBLE_EQ(mean2d.y, -5.0);
}

// tan(fov / 2) = 320 / 400 and 210 / 300, times 1.3.
TEST(FrustumLimits, AreOnePointThreeTanHalfFovForACenterdCamera) {
  const FrustumLimits<double> limits =
      frustum_limits(PinholeCamera<double>{640, 420, 400.0, 300.0, 320.0, 210.0});
  const double tolerance = 1e-7;  // the margin 0.15 is stored as a float
  EXPECT_NEAR(limits.low.x, -1.04, tolerance);
  EXPECT_NEAR(limits.high.x, 1.04, tolerance);
  EXPECT_NEAR(limits.low.y, -0.91, tolerance);
  EXPECT_NEAR(limits.high.y, 0.91, tolerance);
}

TEST(ProjectionJacobian, IsTheDerivativeOfTheMeanInsideTheFrustum) {
  TestRandom random;
  for (int i = 0; i < kJetCases; ++i) {
    const PinholeCamera<double> camera = draw_camera(random);
    const Vec3d p = {random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2), 1.0};
    const Vec3d mean =
        multiply_transposed(camera.cam_from_world_rotation, p - camera.cam_from_world_translation);
    const auto by_jet = [&](double gx, double gy) {
      const auto project = [&](const auto& x) {
        using T = std::decay_t<decltype(x[0])>;
        const PinholeCamera<T> c = camera_as<T>(camera);
        return flatten(project_mean(c, to_camera(c, Unflatten(x).vec3())));
      };
      return jet_gradient(project, flatten(mean), std::array{gx, gy});
    };
    const Mat23<double> A = projection_jacobian(camera, p);
    EXPECT_LT(gradient_error(by_jet(1.0, 0.0), flatten(A.row0)), kJetTolerance);
    EXPECT_LT(gradient_error(by_jet(0.0, 1.0), flatten(A.row1)), kJetTolerance);
  }
}

TEST(ProjectionJacobian, GradientMatchesJetOnBothSidesOfEachFrustumLimit) {
  PinholeCamera<double> camera;
  FrustumVisits visits;
  const double worst = worst_gradient_error(
      [&](const auto& x) {
        using T = std::decay_t<decltype(x[0])>;
        return flatten(projection_jacobian(camera_as<T>(camera), Unflatten(x).vec3()));
      },
      [&](const auto& x, const auto& g) {
        return flatten(projection_jacobian_vjp(camera, Unflatten(x).vec3(), Unflatten(g).mat23()));
      },
      [&](TestRandom& random) {
        camera = draw_camera(random);
        const Vec3d p = draw_point(random);
        visits.add(camera, p);
        return flatten(p);
      });
  EXPECT_LT(worst, kJetTolerance);
  EXPECT_GT(visits.fewest(), kEnoughCases);
}

// A = [2 0 1; 0 3 0], Sigma = [4 1 0; 1 5 0; 0 0 6]. By hand: A Sigma A^T = [22 6; 6 45].
TEST(ProjectCovariance, IsTheHandValue) {
  const Mat23<double> A{{2.0, 0.0, 1.0}, {0.0, 3.0, 0.0}};
  EXPECT_EQ(flatten(project_covariance(A, Sym3<double>{4.0, 1.0, 0.0, 5.0, 0.0, 6.0}, 0.5)),
            (std::array{22.5, 6.0, 45.5}));
}

TEST(Conic, TimesTheCovarianceIsTheIdentity) {
  TestRandom random;
  for (int i = 0; i < 1000; ++i) {
    const Sym2<double> S = draw_covariance2d(random), Q = conic_of(S);
    // The products cancel as many digits as the condition number has, which is at most four here.
    EXPECT_NEAR(Q.xx * S.xx + Q.xy * S.xy, 1.0, 1e-10);
    EXPECT_NEAR(Q.xx * S.xy + Q.xy * S.yy, 0.0, 1e-10);
    EXPECT_NEAR(Q.xy * S.xy + Q.yy * S.yy, 1.0, 1e-10);
  }
}

// |diag(3, 8)| / |diag(3.1, 8.1)|, square root.
TEST(AntialiasFactor, IsTheHandValue) {
  EXPECT_NEAR(antialias_factor(Sym2<double>{3.1, 0.0, 8.1}, 0.1), std::sqrt(24.0 / (3.1 * 8.1)),
              1e-15);
}

TEST(AntialiasFactor, NeverExceedsOneForARealCovariance) {
  TestRandom random;
  for (int i = 0; i < 1000; ++i) {
    Sym2<double> S = draw_covariance2d(random);
    S.xx += 0.1;
    S.yy += 0.1;
    const double factor = antialias_factor(S, 0.1);
    EXPECT_GE(factor, 0.0);
    EXPECT_LE(factor, 1.0);
  }
}

TEST(AntialiasFactor, GradientMatchesJetOnBothSidesOfItsClamp) {
  int zero = 0, positive = 0;
  const double blur = 0.1;
  const double worst = worst_gradient_error(
      [&](const auto& x) {
        using T = std::decay_t<decltype(x[0])>;
        return flatten(antialias_factor(Unflatten(x).sym2(), T(blur)));
      },
      [&](const auto& x, const auto& g) {
        return flatten(by_stored_entry(antialias_factor_vjp(Unflatten(x).sym2(), blur, g[0])));
      },
      [&](TestRandom& random) {
        // One variance is smaller than the blur, so that the matrix without blur is indefinite: the
        // factor is zero.
        Sym2<double> S = draw_covariance2d(random);
        const double rest = random.chance(0.3) ? 0.05 : 0.15;
        if (random.chance(0.5)) S = {rest, 0.0, random.uniform(1.0, 9.0)};
        (antialias_factor(S, blur) > 0.0 ? positive : zero) += 1;
        return flatten(S);
      });
  EXPECT_LT(worst, kJetTolerance);
  EXPECT_GT(std::min(zero, positive), kEnoughCases);
}

// ---- The whole of stage 1 for one Gaussian: parameters -> splat, and its pull-back (splat.h).

constexpr std::size_t kRest = kShBasisCount - 1;

/// The parameters in one flat array: mean, log_scale, rotation, logit_opacity, sh0, sh_rest.
template <class T, std::size_t N>
struct FlatGaussian {
  std::array<Vec3<T>, kRest> sh_rest;
  GaussianParameters<T> parameters;
  explicit FlatGaussian(const std::array<T, N>& flat) {
    Unflatten in(flat);
    parameters = {in.vec3(), in.vec3(), in.quat(), in.scalar(), in.vec3(), sh_rest.data()};
    sh_rest = in.template vec3s<kRest>();
  }
  FlatGaussian(const FlatGaussian&) = delete;  // `parameters` points into it
};

/// A visible Gaussian, inside the frustum's limits or beyond one or two of them.
std::array<double, 59> draw_gaussian(TestRandom& random, const PinholeCamera<double>& camera,
                                     FrustumVisits& visits) {
  const Vec3d p = draw_point(random);
  visits.add(camera, p);
  std::array<Vec3d, kRest> sh_rest;
  for (Vec3d& c : sh_rest) c = random.uniform3(-0.5, 0.5);
  const Vec3d mean =
      multiply_transposed(camera.cam_from_world_rotation, p - camera.cam_from_world_translation);
  return flatten(mean, random.uniform3(-4.5, -1.5), random.quaternion(), random.uniform(-3.0, 5.0),
                 random.uniform3(-2.0, 2.0), sh_rest);
}

/// The worst error of the whole chain under `settings`; a detached antialiasing factor is a
/// constant. A 3D filter is drawn as another parameter, finer and coarser than the Gaussian.
double worst_chain_error(const SplatSettings& settings, FrustumVisits& visits,
                         bool has_filter = false) {
  PinholeCamera<double> camera;
  int invisible = 0;
  double constant_factor = 1.0, filter_scale = 0;
  const bool is_detached = settings.antialias && settings.antialias_detach;
  const double worst = worst_gradient_error(
      [&](const auto& x) {
        using T = std::decay_t<decltype(x[0])>;
        FlatGaussian g(x);
        g.parameters.filter_scale = T(filter_scale);
        const ProjectedGaussian<T> projected =
            project_gaussian(camera_as<T>(camera), g.parameters, settings);
        invisible += !projected.is_visible;
        const BasicSplat<T>& splat = projected.splat;
        const T opacity =
            is_detached ? sigmoid(g.parameters.logit_opacity) * T(constant_factor) : splat.opacity;
        return flatten(splat.mean2d, splat.conic, opacity, splat.color);
      },
      [&](const auto& x, const auto& dL) {
        FlatGaussian g(x);
        g.parameters.filter_scale = filter_scale;
        std::array<Vec3d, kRest> dL_drest{};
        const auto grads = project_gaussian_vjp(camera, g.parameters, settings, splat_gradient(dL),
                                                dL_drest.data());
        return flatten(grads.mean, grads.log_scale, grads.rotation, grads.logit_opacity, grads.sh0,
                       dL_drest);
      },
      [&](TestRandom& random) {
        camera = draw_camera(random);
        if (has_filter) filter_scale = std::exp(random.uniform(-5.0, -1.0));
        const auto x = draw_gaussian(random, camera, visits);
        const FlatGaussian g(x);
        const auto cov2d = project_gaussian(camera, g.parameters, settings).cov2d;
        constant_factor = antialias_factor(cov2d, blur_of<double>(settings));
        return x;
      });
  EXPECT_EQ(invisible, 0);
  return worst;
}

TEST(ProjectGaussian, GradientByEveryParameterMatchesJetForEveryDegree) {
  for (int degree = 0; degree <= 3; ++degree) {
    FrustumVisits visits;
    EXPECT_LT(worst_chain_error({.sh_degree = degree, .near_plane = 0.1f}, visits), kJetTolerance)
        << "degree " << degree;
    EXPECT_GT(visits.fewest(), kEnoughCases);
  }
}

// The cutoff is sigma3, so that Gaussians that the factor makes faint stay visible.
TEST(ProjectGaussian, GradientThroughTheAntialiasFactorMatchesJet) {
  FrustumVisits visits;
  const SplatSettings settings{
      .truncation = Truncation::sigma3, .antialias = true, .antialias_detach = false};
  EXPECT_LT(worst_chain_error(settings, visits), kJetTolerance);
  EXPECT_GT(visits.fewest(), kEnoughCases);
}

TEST(ProjectGaussian, GradientTakesADetachedAntialiasFactorForAConstant) {
  FrustumVisits visits;
  const SplatSettings settings{
      .truncation = Truncation::sigma3, .antialias = true, .antialias_detach = true};
  EXPECT_LT(worst_chain_error(settings, visits), kJetTolerance);
}

// The cutoff is sigma3 here, too.
TEST(ProjectGaussian, GradientThroughThe3dFilterMatchesJet) {
  for (const bool antialias : {false, true}) {
    FrustumVisits visits;
    const SplatSettings settings{.truncation = Truncation::sigma3,
                                 .antialias = antialias,
                                 .antialias_detach = false,
                                 .near_plane = 0.1f};
    EXPECT_LT(worst_chain_error(settings, visits, true), kJetTolerance);
    EXPECT_GT(visits.fewest(), kEnoughCases);
  }
}

/// An ordinary Gaussian straight ahead; each test then makes one field invalid.
struct PlainGaussian {
  std::array<Vec3f, kRest> sh_rest{};
  GaussianParameters<float> parameters{{0.0f, 0.0f, 2.0f},       {-3.0f, -3.0f, -3.0f},
                                       {1.0f, 0.0f, 0.0f, 0.0f}, 0.0f,
                                       {0.0f, 0.0f, 0.0f},       sh_rest.data()};
  bool is_visible(const SplatSettings& settings = {}) const {
    return project_gaussian(Camera{64, 48, 50.0f, 50.0f, 32.0f, 24.0f}, parameters, settings)
        .is_visible;
  }
  PlainGaussian() = default;
  PlainGaussian(const PlainGaussian&) = delete;  // `parameters` points into it
};
constexpr float kFar = std::numeric_limits<float>::infinity();

TEST(ProjectGaussian, IsVisibleFromTheNearToTheFarPlaneInclusive) {
  PlainGaussian g;
  const SplatSettings settings{.near_plane = 1.0f, .far_plane = 3.0f};
  for (const auto& [z, is_visible] :
       {std::pair{0.999f, false}, {1.0f, true}, {3.0f, true}, {3.001f, false}, {-2.0f, false}}) {
    g.parameters.mean.z = z;
    EXPECT_EQ(g.is_visible(settings), is_visible) << z;
  }
}

TEST(ProjectGaussian, IsInvisibleBelowAnOpacityOfOne255th) {
  PlainGaussian g;
  g.parameters.logit_opacity = -5.54f;  // logit(1/255) = -ln 254 = -5.5373
  EXPECT_FALSE(g.is_visible());
  g.parameters.logit_opacity = -5.53f;
  EXPECT_TRUE(g.is_visible());
}

TEST(ProjectGaussian, IsInvisibleWithoutARotation) {
  PlainGaussian g;
  g.parameters.rotation = {0.0f, 0.0f, 0.0f, 0.0f};
  EXPECT_FALSE(g.is_visible());
}

TEST(ProjectGaussian, IsInvisibleWhereAnyParameterIsNotANumberUnderEveryTruncation) {
  for (const Truncation truncation : {Truncation::alpha, Truncation::sigma3}) {
    const auto is_visible_with = [&](auto&& spoil) {
      PlainGaussian g;
      spoil(g.parameters);
      return g.is_visible({.truncation = truncation});
    };
    using G = GaussianParameters<float>;
    EXPECT_TRUE(is_visible_with([](G&) {}));
    EXPECT_FALSE(is_visible_with([](G& g) { g.mean.x = kNan; }));
    EXPECT_FALSE(is_visible_with([](G& g) { g.log_scale.y = kNan; }));
    EXPECT_FALSE(is_visible_with([](G& g) { g.rotation.z = kNan; }));
    EXPECT_FALSE(is_visible_with([](G& g) { g.logit_opacity = kNan; }));
    EXPECT_FALSE(is_visible_with([](G& g) { g.sh0.z = kNan; }));
  }
}

TEST(ProjectGaussian, IsInvisibleWhereASplatWouldLeaveTheRangeOfFloats) {
  PlainGaussian far_aside, huge, glaring;
  far_aside.parameters.mean.x = 3e38f;  // times the focal length
  huge.parameters.log_scale.x = 60.0f;
  glaring.parameters.sh0.x = kFar;
  EXPECT_FALSE(far_aside.is_visible());
  EXPECT_FALSE(huge.is_visible());
  EXPECT_FALSE(glaring.is_visible());
}

}  // namespace
}  // namespace gs
