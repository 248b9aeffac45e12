// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/render/surface_loss.h"

#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

constexpr int kWidth = 96, kHeight = 72;

/// Two cameras beside each other in front of a textured plane, and what they see of it.
struct PlaneScene {
  PinholeCamera<double> camera{kWidth, kHeight, 80.0, 82.0, 47.0, 36.5}, other = camera;
  Vec3d normal{0.3, -0.2, -1.0};  // in the axes of `camera`
  double distance = 0;            // normal . X = distance
  std::vector<float> seen, seen_by_other;

  PlaneScene() {
    normal = normal / std::sqrt(inner(normal, normal));
    distance = normal.z * 2.0;  // through (0, 0, 2)
    other.cam_from_world_rotation = rotation_matrix(Quat<double>{1.0, 0.01, -0.04, 0.02});
    other.cam_from_world_translation = {-0.25, 0.05, 0.02};
    seen = picture(camera);
    seen_by_other = picture(other);
  }
  std::vector<float> picture(const PinholeCamera<double>& from) const {
    const Vec3d eye = from.position();
    std::vector<float> gray;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const Vec3d ray = multiply_transposed(
            from.cam_from_world_rotation,
            Vec3d((x + 0.5 - from.cx) / from.fx, (y + 0.5 - from.cy) / from.fy, 1.0));
        const Vec3d X = eye + ray * ((distance - inner(normal, eye)) / inner(normal, ray));
        gray.push_back(
            float(0.5 + 0.2 * std::sin(9 * X.x + 4 * X.y) + 0.2 * std::cos(7 * X.y - 3 * X.x)));
      }
    return gray;
  }
  GrayPhoto photo() const { return {seen.data(), kWidth, kHeight}; }
  GrayPhoto other_photo() const { return {seen_by_other.data(), kWidth, kHeight}; }
  PixelSurface<double> surface(int x, int y) const {
    const Vec3d u{(x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, 1.0};
    return {inner(normal, u) / distance, {0.0, 0.0}, normal * 0.9};
  }
  PhotoMismatch<double> mismatch(int x, int y, const PixelSurface<double>& at) const {
    return photo_mismatch(camera, seen_from(camera, other), x, y, at, photo(), other_photo());
  }
  template <class F>
  void for_each_patch(F&& f) const {
    for (int y = 5; y < kHeight; y += 9)
      for (int x = 5; x < kWidth; x += 9) f(x, y);
  }
};

TEST(SurfaceLoss, GradientOfNormalsMatchesJet) {
  const auto camera = [](const auto& x) {
    using T = typename std::remove_cvref_t<decltype(x)>::value_type;
    return PinholeCamera<T>{640, 480, T(500.0), T(520.0), T(310.0), T(250.0)};
  };
  const auto surface = [](const auto& x) {
    using T = typename std::remove_cvref_t<decltype(x)>::value_type;
    Unflatten in(x);
    PixelSurface<T> at;
    at.o = in.scalar();
    at.slope = in.vec2();
    at.normal = in.vec3();
    return at;
  };
  const double worst = worst_gradient_error(
      [&](const auto& x) {
        using T = typename std::remove_cvref_t<decltype(x)>::value_type;
        return std::array{normal_error(camera(x), Vec2<T>(T(120.0), T(-70.0)), surface(x))};
      },
      [&](const auto& x, const auto& g) {
        const PixelSurface<double> dL =
            normal_error_vjp(camera(x), Vec2<double>(120.0, -70.0), surface(x), g[0]);
        return flatten(dL.o, dL.slope, dL.normal);
      },
      [](TestRandom& random) {
        return flatten(random.uniform(0.2, 1.0),
                       Vec2<double>(random.uniform(-1e-3, 1e-3), random.uniform(-1e-3, 1e-3)),
                       random.uniform3(-1.0, 1.0));
      });
  EXPECT_LT(worst, kJetTolerance);
}

TEST(SurfaceLoss, GradientOfThePriorMatchesJet) {
  const Vec3d prior{0.3, -0.4, -0.7};
  const double worst = worst_gradient_error(
      [&](const auto& x) {
        using T = typename std::remove_cvref_t<decltype(x)>::value_type;
        Unflatten in(x);
        return std::array{prior_error(in.vec3(), Vec3<T>(T(prior.x), T(prior.y), T(prior.z)))};
      },
      [&](const auto& x, const auto& g) {
        return flatten(prior_error_vjp(Unflatten(x).vec3(), prior, g[0]));
      },
      [](TestRandom& random) { return flatten(random.uniform3(-1.0, 1.0)); });
  EXPECT_LT(worst, kJetTolerance);
}

TEST(SurfaceLoss, NormalOfAPlaneIsExact) {
  const PlaneScene scene;
  const auto o = [&](int x, int y) { return scene.surface(x, y).o; };
  PixelSurface<double> at = scene.surface(70, 20);
  at.slope = {(o(71, 20) - o(69, 20)) / 2, (o(70, 21) - o(70, 19)) / 2};
  EXPECT_NEAR(normal_error(scene.camera, {70.5 - scene.camera.cx, 20.5 - scene.camera.cy}, at), 0,
              1e-12);
}

TEST(SurfaceLoss, PhotosOfThePlaneAgree) {
  const PlaneScene scene;
  int known = 0;
  scene.for_each_patch([&](int x, int y) {
    const PhotoMismatch<double> found = scene.mismatch(x, y, scene.surface(x, y));
    known += found.is_known;
    if (found.is_known) {
      EXPECT_LT(found.error, 0.01) << x << " " << y;
    }
  });
  EXPECT_GT(known, 40);  // the others lie beside the other photo
}

TEST(SurfaceLoss, GradientOfPhotosIsTheSlope) {
  const PlaneScene scene;
  TestRandom random;
  constexpr double kStep = 1e-6;
  int known = 0, wrong = 0;
  scene.for_each_patch([&](int x, int y) {
    PixelSurface<double> at = scene.surface(x, y);
    at.o *= random.uniform(0.98, 1.02);
    at.normal += random.uniform3(-0.1, 0.1);
    const PhotoMismatch<double> found = scene.mismatch(x, y, at);
    if (!found.is_known) return;
    ++known;
    const auto slope = [&](double& number) {
      const double value = number;
      number = value + kStep;
      const double above = scene.mismatch(x, y, at).error;
      number = value - kStep;
      const double below = scene.mismatch(x, y, at).error;
      number = value;
      return (above - below) / (2 * kStep);
    };
    const double by[4] = {slope(at.o), slope(at.normal.x), slope(at.normal.y), slope(at.normal.z)};
    const double is[4] = {found.by_o, found.by_normal.x, found.by_normal.y, found.by_normal.z};
    double largest = 0, worst = 0;
    for (int k = 0; k < 4; ++k) {
      largest = std::max(largest, std::abs(by[k]));
      worst = std::max(worst, std::abs(by[k] - is[k]));
    }
    wrong += worst > 1e-5 * largest;  // a sample may change its four pixels within the step
  });
  EXPECT_GT(known, 40);
  EXPECT_LE(wrong, 2);
}

TEST(SurfaceLoss, PhotosPullTheSurfaceToThePlane) {
  const PlaneScene scene;
  int known = 0, right = 0;
  for (const double factor : {0.99, 1.01})
    scene.for_each_patch([&](int x, int y) {
      PixelSurface<double> at = scene.surface(x, y);
      at.o *= factor;
      const PhotoMismatch<double> found = scene.mismatch(x, y, at);
      known += found.is_known;
      right += found.is_known && (found.by_o > 0) == (factor > 1);
    });
  EXPECT_GT(known, 80);
  EXPECT_GE(right, 0.9 * known);
}

TEST(SurfaceLoss, LightOfAPhotoDoesNotMatter) {
  PlaneScene scene, darker;
  for (float& value : darker.seen_by_other) value = 0.5f * value + 0.2f;
  scene.for_each_patch([&](int x, int y) {
    PixelSurface<double> at = scene.surface(x, y);
    at.o *= 1.01;
    const PhotoMismatch<double> one = scene.mismatch(x, y, at), two = darker.mismatch(x, y, at);
    ASSERT_EQ(one.is_known, two.is_known);
    EXPECT_NEAR(one.error, two.error, 1e-4);
    EXPECT_NEAR(one.by_o, two.by_o, 1e-3 * std::abs(one.by_o) + 1e-4);
  });
}

TEST(SurfaceLoss, PhotosSayNothingBehindTheCameraUnderAMaskOrBesideThePhoto) {
  PlaneScene scene;
  const PixelSurface<double> at = scene.surface(48, 36);
  EXPECT_TRUE(scene.mismatch(48, 36, at).is_known);
  EXPECT_FALSE(scene.mismatch(2, 36, at).is_known);
  PixelSurface<double> away = at;
  away.normal = at.normal * -1.0;
  EXPECT_FALSE(scene.mismatch(48, 36, away).is_known);
  PlaneScene turned = scene;
  turned.other.cam_from_world_rotation = rotation_matrix(Quat<double>{0.0, 0.0, 1.0, 0.0});
  EXPECT_FALSE(turned.mismatch(48, 36, at).is_known);
  scene.seen[36 * kWidth + 50] = -1;
  EXPECT_FALSE(scene.mismatch(48, 36, at).is_known);
}

}  // namespace
}  // namespace gs
