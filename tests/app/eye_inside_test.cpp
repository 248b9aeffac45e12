// SPDX-License-Identifier: Apache-2.0
// Where the viewer begins in models without cameras.
#include "gs_app/view/eye_inside.h"

#include <gtest/gtest.h>

#include <cmath>

#include "gs_core/geometry/vectors.h"
#include "gs_core/math/random.h"

namespace gs {
namespace {

/// Small opaque Gaussians at these places.
Gaussians surface(const std::vector<Vec3f>& means) {
  Gaussians gaussians;
  gaussians.resize(means.size());
  gaussians.fill_zero();
  for (std::size_t i = 0; i < means.size(); ++i) {
    gaussians.mean[i] = means[i];
    gaussians.log_scale[i] = Vec3f(std::log(0.15f));
    gaussians.rotation[i] = {1, 0, 0, 0};
    gaussians.logit_opacity[i] = 4;
  }
  return gaussians;
}

Vec3f on_sphere(std::size_t i, float radius) {
  const auto draw = Random{3, RandomStream::test}.normal4(i, 0);
  const Vec3f p(draw.x, draw.y, draw.z);
  return (radius / length(p)) * p;
}

/// The walls, the floor and the ceiling of a room 8 x 3 x 8 units large. Up is -y.
void add_room(std::vector<Vec3f>& means) {
  for (float a = -4; a <= 4; a += 0.2f) {
    for (float b = -4; b <= 4; b += 0.2f) {
      means.push_back({a, 1.5f, b});
      means.push_back({a, -1.5f, b});
      if (std::abs(b) > 1.5f) continue;
      for (const float wall : {-4.f, 4.f}) {
        means.push_back({wall, b, a});
        means.push_back({a, b, wall});
      }
    }
  }
}

std::optional<Vec3d> eye_of(const std::vector<Vec3f>& means) {
  const Gaussians gaussians = surface(means);
  return eye_inside(gaussians, scene_frame({}, gaussians.mean.span()));
}

TEST(EyeInside, ARoomAroundAnObjectIsLookedAtFromBetweenThem) {
  std::vector<Vec3f> means;
  add_room(means);
  for (std::size_t i = 0; i < 1500; ++i) means.push_back(on_sphere(i, 0.9f));
  const std::optional<Vec3d> eye = eye_of(means);
  ASSERT_TRUE(eye.has_value());
  EXPECT_GT(length(*eye), 1.2);  // outside of the object
  EXPECT_LT(std::max(std::abs(eye->x), std::abs(eye->z)), 4);
  EXPECT_LT(eye->y, 0);  // above the middle
  EXPECT_GT(eye->y, -1.5);
}

TEST(EyeInside, AnObjectIsLookedAtFromOutsideWhetherHollowOrNot) {
  std::vector<Vec3f> hollow, solid, thin;
  for (std::size_t i = 0; i < 4000; ++i) {
    hollow.push_back(on_sphere(i, 2));
    solid.push_back(on_sphere(i, 2 * std::cbrt(float(i) / 4000)));
    thin.push_back(on_sphere(i, 2));
    thin.back().x *= 0.2f;
    thin.back().z *= 0.2f;
  }
  EXPECT_FALSE(eye_of(hollow));
  EXPECT_FALSE(eye_of(solid));
  EXPECT_FALSE(eye_of(thin));
  EXPECT_FALSE(eye_of({}));
  EXPECT_FALSE(eye_of({{1, 2, 3}}));
}

}  // namespace
}  // namespace gs
