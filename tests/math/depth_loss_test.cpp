// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/loss/depth_loss.h"

#include "tests/support/jet_oracle.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

TEST(DepthLoss, GradientOfTheInverseDepthMatchesJet) {
  const double worst = worst_gradient_error(
      [](const auto& x) { return flatten(inverse_depth(x[0], x[1])); },
      [](const auto& x, const auto& g) {
        const auto dL = inverse_depth_vjp(x[0], x[1], g[0]);
        return flatten(dL.Z, dL.A);
      },
      [](TestRandom& random) {
        return std::array{random.uniform(0.01, 20.0), random.uniform(0.01, 1.0)};
      });
  EXPECT_LT(worst, kJetTolerance);
}

TEST(DepthLoss, GradientOfAPixelMatchesJetOnBothSidesOfTheMap) {
  for (const double side : {0.7, 1.4})
    EXPECT_LT(worst_gradient_error(
                  [&](const auto& x) {
                    using T = std::decay_t<decltype(x[0])>;
                    return flatten(depth_error(x[0], x[1], T(side * 0.5), T(0.3)));
                  },
                  [&](const auto& x, const auto& g) {
                    const auto dL = depth_error_vjp(x[0], x[1], side * 0.5, 0.3);
                    return flatten(g[0] * dL.Z, g[0] * dL.A);
                  },
                  [](TestRandom& random) {
                    const double A = random.uniform(0.05, 1.0);
                    return std::array{2 * A * random.uniform(0.9, 1.1), A};  // q is about 1/2
                  }),
              kJetTolerance);
}

TEST(DepthLoss, IsFlatWhereTheDepthIsTheMaps) {
  const auto dL = depth_error_vjp(4.0, 0.5, 0.125, 3.0);
  EXPECT_EQ(dL.Z, 0);
  EXPECT_EQ(dL.A, 0);
}

// The depth of a splat is that of the Gaussian's center, whatever its shape.
TEST(DepthLoss, GradientOfASplatsDepthMatchesJet) {
  const PinholeCamera<double> camera = camera_as<double>(random_camera(40, 30, 5));
  SplatSettings settings;
  settings.sh_degree = 0;
  settings.near_plane = -1000;  // so that every draw is visible
  const auto gaussian_of = [](const auto& x) {
    Unflatten in(x);
    using T = std::decay_t<decltype(x[0])>;
    GaussianParameters<T> gaussian{};
    gaussian.mean = in.vec3();
    gaussian.log_scale = Vec3<T>(T(-1));
    gaussian.rotation = {T(1), T(0), T(0), T(0)};
    gaussian.logit_opacity = T(1);
    gaussian.sh0 = Vec3<T>(T(0));
    return gaussian;
  };
  const double worst = worst_gradient_error(
      [&](const auto& x) {
        using T = std::decay_t<decltype(x[0])>;
        return flatten(project_gaussian(camera_as<T>(camera), gaussian_of(x), settings).depth);
      },
      [&](const auto& x, const auto& g) {
        BasicSplatGradient<double> dL_dsplat{};
        dL_dsplat.depth = g[0];
        Vec3d* const no_sh_rest = nullptr;
        return flatten(
            project_gaussian_vjp(camera, gaussian_of(x), settings, dL_dsplat, no_sh_rest).mean);
      },
      [&](TestRandom& random) {
        const Vec3d p{random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(2, 6)};
        return flatten(multiply_transposed(camera.cam_from_world_rotation,
                                           p - camera.cam_from_world_translation));
      });
  EXPECT_LT(worst, kJetTolerance);
}

// ---- the fit -----------------------------------------------------------------------------------

/// The sums of 50 pixels of coverage A whose depths are known; `value` makes the map's value of
/// one.
template <class Value>
DepthSums sums_of(DepthKind kind, Value&& value, double A = 0.8) {
  DepthSums sums;
  for (int i = 0; i < 50; ++i) {
    const double depth = 1.5 + 0.1 * i;
    add_to(sums, depth_sums_of_pixel(kind, value(depth), 1, A * depth, A));
  }
  return sums;
}

TEST(DepthFit, FindsScaleAndShiftOfEachKind) {
  const auto relative =
      depth_target(DepthKind::relative,
                   sums_of(DepthKind::relative, [](double depth) { return (depth + 0.4) / 3; }), 1);
  EXPECT_NEAR(relative.fit.scale, 3, 1e-9);
  EXPECT_NEAR(relative.fit.shift, -0.4, 1e-9);
  EXPECT_NEAR(inverse_depth_of(DepthKind::relative, relative.fit, (2.5 + 0.4) / 3), 0.4, 1e-9);
  const auto inverse =
      depth_target(DepthKind::inverse,
                   sums_of(DepthKind::inverse, [](double depth) { return 7 / depth + 2; }), 1);
  EXPECT_NEAR(inverse.fit.scale, 1.0 / 7, 1e-9);
  EXPECT_NEAR(inverse.fit.shift, -2.0 / 7, 1e-9);
  EXPECT_NEAR(inverse_depth_of(DepthKind::inverse, inverse.fit, 7 / 2.5 + 2), 0.4, 1e-9);
  const auto scaled = depth_target(
      DepthKind::scaled, sums_of(DepthKind::scaled, [](double depth) { return 5 * depth; }), 1);
  EXPECT_NEAR(inverse_depth_of(DepthKind::scaled, scaled.fit, 5 * 2.5), 0.4, 1e-9);
  const auto metric = depth_target(
      DepthKind::metric, sums_of(DepthKind::metric, [](double depth) { return 5 * depth; }), 1);
  EXPECT_NEAR(inverse_depth_of(DepthKind::metric, metric.fit, 2.5), 0.4, 1e-9);
}

// w = factor m A, and sum w t0 = n sum m: with one t0 the loss is the relative error times A.
TEST(DepthFit, MakesTheLossARelativeError) {
  DepthSums sums;
  for (int i = 0; i < 10; ++i)
    add_to(sums, depth_sums_of_pixel(DepthKind::metric, 4.0, 1, 0.5 * 5.0, 0.5));
  const DepthTarget target = depth_target(DepthKind::metric, sums, 1);
  double loss = 0;
  for (int i = 0; i < 10; ++i) {
    double share;
    depth_pixel_vjp(DepthKind::metric, target, 4.0f, 1, 2.5f, 0.5f, &share);
    loss += share;
  }
  EXPECT_NEAR(loss, 0.5 * (1.0 / 4 - 1.0 / 5) / (1.0 / 4), 1e-6);
}

TEST(DepthFit, OfAMapThatSaysTheOppositeTeachesNothing) {
  const auto depth_as_inverse =
      depth_target(DepthKind::inverse, sums_of(DepthKind::inverse, [](double d) { return d; }), 1);
  EXPECT_EQ(depth_as_inverse.factor, 0);
  const auto inverse_as_depth = depth_target(
      DepthKind::relative, sums_of(DepthKind::relative, [](double d) { return 1 / d; }), 1);
  EXPECT_EQ(inverse_as_depth.factor, 0);
}

TEST(DepthFit, OfAConstantMapTeachesNothing) {
  for (const DepthKind kind : {DepthKind::relative, DepthKind::inverse}) {
    const auto constant = [](double) { return 3.0; };
    EXPECT_EQ(depth_target(kind, sums_of(kind, constant), 1).factor, 0);
  }
}

TEST(DepthFit, WithoutAnyCoverageTeachesNothing) {
  for (const DepthKind kind :
       {DepthKind::metric, DepthKind::scaled, DepthKind::relative, DepthKind::inverse}) {
    const auto value = [](double depth) { return depth; };
    EXPECT_EQ(depth_target(kind, sums_of(kind, value, 0.001), 1).factor, 0);
    EXPECT_EQ(depth_target(kind, {}, 1).factor, 0);
  }
}

TEST(DepthPixel, ThatTheMapDoesNotKnowHasNoGradient) {
  const DepthTarget target{{1, 0}, 1, 1};
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  for (const float value : {0.0f, -1.0f, nan, infinity}) {
    EXPECT_EQ(depth_pixel_vjp(DepthKind::metric, target, value, 1, 2, 1).Z, 0) << value;
    EXPECT_FALSE(is_known_depth(value));
  }
  EXPECT_EQ(depth_pixel_vjp(DepthKind::metric, target, 3, 0, 2, 1).Z, 0) << "masked";
  EXPECT_EQ(depth_pixel_vjp(DepthKind::metric, target, 3, 1, 0, 0).Z, 0) << "not covered";
  // A fitted inverse depth below 0 lies beyond infinity.
  EXPECT_EQ(depth_pixel_vjp(DepthKind::inverse, {{1, -5}, 1, 1}, 3, 1, 2, 1).Z, 0);
  EXPECT_NE(depth_pixel_vjp(DepthKind::metric, target, 3, 1, 2, 1).Z, 0);
}

}  // namespace
}  // namespace gs
