// SPDX-License-Identifier: Apache-2.0
// Pictures of triangles against the colors that rays find.
#include "gs_render/mesh/draw_mesh.h"

#include <cmath>

#include "gs_core/threads/parallel.h"
#include "tests/support/test.h"

namespace gs {
namespace {

constexpr Vec3f kSky{0.25f, 0.5f, 0.75f};

/// Looks along z from the origin.
Camera camera_of(int width, int height, float focal) {
  Camera camera;
  camera.width = width, camera.height = height;
  camera.fx = camera.fy = focal;
  camera.cx = 0.5f * float(width), camera.cy = 0.5f * float(height);
  return camera;
}

/// A quad of two triangles with the four corners in turn.
TriangleMesh quad(const std::array<Vec3f, 4>& corners, const std::array<Rgb8, 4>& colors) {
  TriangleMesh mesh;
  mesh.vertices.assign(corners.begin(), corners.end());
  mesh.colors.assign(colors.begin(), colors.end());
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

TriangleMesh plain_square(float z, float half, Rgb8 color) {
  return quad({Vec3f(-half, -half, z), {half, -half, z}, {half, half, z}, {-half, half, z}},
              {color, color, color, color});
}

TEST(DrawMesh, CoversThePixelsInFrontOfItFromBothSides) {
  const Camera camera = camera_of(8, 6, 4);
  TriangleMesh mesh = plain_square(2, 1, {255, 0, 51});  // pixels 2 to 5 and 1 to 4
  for (int side = 0; side < 2; ++side) {
    const MeshPicture picture = draw_mesh(mesh, camera, kSky);
    EXPECT_DOUBLE_EQ(picture.covered, 16.0 / 48);
    for (int y = 0; y < 6; ++y)
      for (int x = 0; x < 8; ++x) {
        const bool is_inside = x >= 2 && x < 6 && y >= 1 && y < 5;
        const Vec3f expected = is_inside ? Vec3f(1, 0, 0.2f) : kSky;
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(picture.color.at(x, y, c), expected[c], 1e-6);
      }
    for (Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
  }
}

TEST(DrawMesh, ShowsTheNearestTriangleInAnyOrder) {
  const Camera camera = camera_of(8, 6, 4);
  for (const bool far_first : {false, true}) {
    TriangleMesh mesh =
        plain_square(far_first ? 4 : 2, 1, {std::uint8_t(far_first ? 0 : 255), 0, 0});
    const TriangleMesh other =
        plain_square(far_first ? 2 : 4, 1, {std::uint8_t(far_first ? 255 : 0), 0, 0});
    mesh.vertices.insert(mesh.vertices.end(), other.vertices.begin(), other.vertices.end());
    mesh.colors.insert(mesh.colors.end(), other.colors.begin(), other.colors.end());
    mesh.triangles.push_back({4, 5, 6});
    mesh.triangles.push_back({4, 6, 7});
    EXPECT_NEAR(draw_mesh(mesh, camera, kSky).color.at(4, 3, 0), 1, 1e-6);
  }
}

// A floor that begins behind the camera: its color is linear along it, and its pictures are not.
TEST(DrawMesh, InterpolatesInPerspectiveAndCutsWhatIsBehind) {
  const Camera camera = camera_of(64, 48, 40);
  constexpr float kHeight = 1, kFirst = -10, kLast = 30;
  TriangleMesh mesh = quad({Vec3f(-99, kHeight, kFirst),
                            {99, kHeight, kFirst},
                            {99, kHeight, kLast},
                            {-99, kHeight, kLast}},
                           {Rgb8{0, 0, 0}, {0, 0, 0}, {255, 0, 0}, {255, 0, 0}});
  const auto expect_floor = [&] {
    const MeshPicture picture = draw_mesh(mesh, camera, kSky);
    for (int y = 27; y < 48; ++y)
      for (int x = 0; x < 64; x += 7) {
        double mean = 0;  // over the rows of samples
        for (const double row : {y + 0.25, y + 0.75}) {
          const double z = kHeight * camera.fy / (row - camera.cy);
          mean += (z - kFirst) / (kLast - kFirst) / 2;
        }
        EXPECT_NEAR(picture.color.at(x, y, 0), mean, 2e-5) << x << " " << y;
      }
    EXPECT_EQ(picture.color.at(5, 10, 2), kSky.z);
  };
  expect_floor();
  // The same by a texture, whose texels are as far apart as the places of their middles.
  mesh.texture = Image8(256, 2, 3);
  for (int x = 0; x < 256; ++x)
    for (int y = 0; y < 2; ++y) mesh.texture.at(x, y, 0) = std::uint8_t(x);
  const float begin = 0.5f / 256, end = 255.5f / 256;
  mesh.texture_places = {{begin, 0}, {begin, 1}, {end, 1}, {end, 0}};
  expect_floor();
}

TEST(DrawMesh, IsTheSameForAnyThreads) {
  const Camera camera = camera_of(100, 90, 50);
  TriangleMesh mesh;
  for (std::uint32_t i = 0; i < 300; ++i) {
    const float t = float(i);
    mesh.vertices.emplace_back(std::sin(7 * t), std::cos(5 * t), 1.2f + std::sin(3 * t));
    mesh.colors.push_back({std::uint8_t(i), std::uint8_t(3 * i), std::uint8_t(7 * i)});
    if (i > 1) mesh.triangles.push_back({i - 2, i - 1, i});
  }
  set_thread_count(1);
  const MeshPicture one = draw_mesh(mesh, camera, kSky);
  set_thread_count(4);
  const MeshPicture four = draw_mesh(mesh, camera, kSky);
  set_thread_count(0);
  EXPECT_EQ(one.color.pixels, four.color.pixels);
  EXPECT_EQ(one.covered, four.covered);
  EXPECT_GT(one.covered, 0.3);
}

}  // namespace
}  // namespace gs
