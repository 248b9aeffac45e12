// SPDX-License-Identifier: Apache-2.0
// Pictures through the lenses of `gemsplat render --lens`.
#include "gs_app/export/view_lens.h"

#include <gmock/gmock.h>

#include <numbers>

#include "gs_core/math/lens/lens_projection.h"
#include "gs_train/stages/scalar_stages.h"
#include "tests/support/error_of.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

using std::numbers::pi;

/// Small Gaussians in all directions from the origin.
Gaussians all_around() {
  Draws draws(5);
  Gaussians gaussians(300, host_memory());
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    Vec3f direction = draws.uniform3(-1, 1);
    direction /= std::sqrt(inner(direction, direction));
    const Vec3f color = draws.uniform3(0, 1);
    const float opacity = draws.uniform(0.5f, 0.95f);
    const float size = draws.uniform(0.08f, 0.2f);
    const Vec3f place = draws.uniform(2.0f, 3.0f) * direction;
    set_gaussian(gaussians, i, place, size, opacity, color);
  }
  return gaussians;
}

/// A camera at the origin, `turn` radians to the right of +z.
Camera turned(double turn) {
  Camera camera;
  camera.width = 64, camera.height = 48;
  camera.fx = camera.fy = 40, camera.cx = 32, camera.cy = 24;
  const auto c = float(std::cos(turn)), s = float(std::sin(turn));
  camera.cam_from_world_rotation = {{c, 0, -s}, {0, 1, 0}, {s, 0, c}};
  return camera;
}

const Vec3d kUp(0, -1, 0);

class ViewLens : public ::testing::Test {
 protected:
  std::vector<ImageF> panorama(double turn, const std::vector<Quantity>& quantities) {
    return panorama_values(pictures_, panorama_camera(turned(turn), kUp, kWidth), quantities);
  }
  static constexpr int kWidth = 256;
  const std::unique_ptr<Backend> backend_ = make_scalar_backend();
  const Gaussians gaussians_ = all_around();
  ViewPictures pictures_{*backend_, gaussians_, gaussians_, {}, false};
};

/// The largest difference, where the first is turned by some columns.
float largest_difference(const ImageF& a, const ImageF& b, int columns) {
  float largest = 0;
  for (int y = 0; y < a.height; ++y)
    for (int x = 0; x < a.width; ++x)
      for (int c = 0; c < a.channels; ++c)
        largest = std::max(largest, std::abs(a.at((x + columns) % a.width, y, c) - b.at(x, y, c)));
  return largest;
}

// The seam and the places where the two fisheyes meet lie elsewhere in the scene then.
TEST_F(ViewLens, APanoramaDoesNotDependOnTheWayAhead) {
  const std::vector<ImageF> ahead = panorama(0, {Quantity::color, Quantity::alpha});
  for (const int columns : {kWidth / 4, kWidth / 2, 3 * kWidth / 8}) {
    const auto other = panorama(2 * pi * columns / kWidth, {Quantity::color, Quantity::alpha});
    EXPECT_LT(largest_difference(ahead[0], other[0], columns), 0.06f) << columns;
    EXPECT_LT(largest_difference(ahead[1], other[1], columns), 0.06f) << columns;
  }
}

TEST_F(ViewLens, APanoramaIsContinuousAtItsSeamAndAtThePoles) {
  const ImageF color = panorama(0.3, {Quantity::color})[0];
  float inside = 0, at_seam = 0, at_poles = 0;
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < color.height; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const float step = std::abs(color.at((x + 1) % kWidth, y, c) - color.at(x, y, c));
        (x == kWidth - 1 ? at_seam : inside) = std::max(x == kWidth - 1 ? at_seam : inside, step);
        if (y == 0 || y == color.height - 1)  // the row next to a pole, and what is opposite
          at_poles = std::max(
              at_poles, std::abs(color.at((x + kWidth / 2) % kWidth, y, c) - color.at(x, y, c)));
      }
  EXPECT_LE(at_seam, inside + 2.0f / 255);
  EXPECT_LE(at_poles, inside + 2.0f / 255);
}

TEST_F(ViewLens, APanoramaShowsDirectionsWhereItSays) {
  const Camera camera = panorama_camera(turned(0.8), kUp, kWidth);
  const ImageF alpha = panorama(0.8, {Quantity::alpha})[0];
  std::size_t shown = 0;
  for (std::size_t i = 0; i < gaussians_.count(); ++i) {
    const Vec3f p = multiply(camera.cam_from_world_rotation, gaussians_.mean[i]);
    const int x = int((std::atan2(p.x, p.z) / (2 * pi) + 0.5) * kWidth);
    const int y = int((std::atan2(p.y, std::hypot(p.x, p.z)) / pi + 0.5) * kWidth / 2);
    if (alpha.at(x, y, 0) > 0.4f) ++shown;
  }
  EXPECT_EQ(shown, gaussians_.count());
}

TEST_F(ViewLens, DepthOfAPanoramaIsTheDistanceInAllDirections) {
  const ImageF depth = panorama(0.8, {Quantity::depth})[0];
  for (const float value : depth.pixels)
    EXPECT_TRUE(value == 0 || (value > 1.9f && value < 3.1f)) << value;
}

TEST(PanoramaCamera, IsLevelAndLooksWhereTheCameraDoes) {
  Camera tilted = turned(0.8);
  const Mat3<float> W = tilted.cam_from_world_rotation;  // turned down by half a radian
  const float c = std::cos(0.5f), s = std::sin(0.5f);
  tilted.cam_from_world_rotation = {W.row0, c * W.row1 - s * W.row2, s * W.row1 + c * W.row2};
  tilted.cam_from_world_translation = {1, 2, 3};
  const Camera level = panorama_camera(tilted, kUp, 0), expected = turned(0.8);
  EXPECT_EQ(level.width, 248);  // 2 pi 40, in steps of 4
  EXPECT_EQ(level.height, 124);
  const Vec3f moved = level.position() - tilted.position();
  EXPECT_LT(inner(moved, moved), 1e-10f);
  const auto same = [](const Vec3f& a, const Vec3f& b) { return inner(a - b, a - b) < 1e-10f; };
  EXPECT_TRUE(same(level.cam_from_world_rotation.row0, expected.cam_from_world_rotation.row0));
  EXPECT_TRUE(same(level.cam_from_world_rotation.row1, expected.cam_from_world_rotation.row1));
  // Straight down, the top of the picture is ahead.
  Camera from_above = turned(0);
  from_above.cam_from_world_rotation = {{1, 0, 0}, {0, 0, -1}, {0, 1, 0}};
  EXPECT_TRUE(same(panorama_camera(from_above, kUp, 0).cam_from_world_rotation.row2, {0, 0, 1}));
}

TEST(FisheyeCamera, HasItsAngleAcrossTheWidth) {
  const Camera camera = with_fisheye(turned(0), 200);
  const double half = 100 * pi / 180;
  const Vec3f at_border(float(std::sin(half)), 0, float(std::cos(half)));
  EXPECT_NEAR(project_through_lens(camera, at_border).mean2d.x, 64, 1e-4);
  EXPECT_THAT(error_of([] { with_fisheye(turned(0), 340); }), testing::HasSubstr("--fov 340"));
}

TEST(ParallelRays, ShowTheSameWidthAtEveryDepth) {
  const Camera camera = with_parallel_rays(turned(0), 5);
  for (const float z : {0.5f, 1.0f, 70.0f})
    EXPECT_NEAR(project_through_lens(camera, Vec3f(2.5f, 0, z)).mean2d.x, 64, 1e-4);
}

}  // namespace
}  // namespace gs
