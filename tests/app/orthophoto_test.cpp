// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/orthophoto.h"

#include <cstdio>

#include "gs_app/export/view_pictures.h"
#include "gs_train/stages/scalar_stages.h"
#include "tests/support/error_of.h"
#include "tests/support/scenes.h"
#include "tests/support/test.h"

namespace gs {
namespace {

/// A scene whose up is its y axis, tilted and turned, of 2.5 m a unit.
Georeference tilted_scene() {
  const double c = std::cos(0.7), s = std::sin(0.7), d = std::cos(0.2), t = std::sin(0.2);
  const Mat3<double> about_up{{c, -s, 0}, {s, c, 0}, {0, 0, 1}};
  const Mat3<double> tilt{{1, 0, 0}, {0, -t, -d}, {0, d, -t}};  // y becomes up
  Mat3<double> R;
  for (int column = 0; column < 3; ++column) {
    Vec3d axis(0.0);
    axis[column] = 1;
    const Vec3d turned = multiply(about_up, multiply(tilt, axis));
    R.row0[column] = turned.x, R.row1[column] = turned.y, R.row2[column] = turned.z;
  }
  return {{15.9, 48.2, 300}, {2.5, R, {40, -20, 5}}};
}

// Small Gaussians are seen where their coordinates in the zone say, to less than a pixel.
TEST(Orthophoto, PixelsAreWhereTheWorldFileSays) {
  const Georeference georeference = tilted_scene();
  const Vec3d offset(1000, -2000, 500);
  constexpr std::size_t kCount = 12;
  constexpr double kMeters = 0.25;
  Draws draws(4);
  Gaussians gaussians(kCount, host_memory());
  for (std::size_t i = 0; i < kCount; ++i)
    set_gaussian(gaussians, i, {draws.uniform(-8, 8), draws.uniform(-1, 1), draws.uniform(-8, 8)},
                 0.05f, 0.99f, Vec3f(1));
  Camera camera;  // 12 units above the middle
  const Vec3d up = georeference.enu_from_input.R.row2;
  camera.cam_from_world_translation = Vec3f(-12.0 * up);
  const Orthophoto photo =
      orthophoto_of(georeference, gaussians.mean.span(), {camera}, offset, kMeters);
  EXPECT_EQ(photo.zone.number, 33);
  EXPECT_FALSE(photo.zone.is_south);
  const std::unique_ptr<Backend> backend = make_scalar_backend();
  ViewPictures pictures(*backend, gaussians, gaussians, {}, false);
  const ImageF alpha = pictures.values(photo.camera, {Quantity::alpha})[0];
  for (std::size_t i = 0; i < kCount; ++i) {
    const Vec3d input = Vec3d(gaussians.mean[i]) + offset;
    const Vec3d utm = utm_of(photo.zone, geodetic_of(georeference.ecef_of_input(input)));
    const double x = (utm.x - photo.easting) / kMeters, y = (photo.northing - utm.y) / kMeters;
    double sum = 0, at_x = 0, at_y = 0;  // of what is seen around
    for (int v = std::max(int(y) - 2, 0); v <= std::min(int(y) + 3, alpha.height - 1); ++v)
      for (int u = std::max(int(x) - 2, 0); u <= std::min(int(x) + 3, alpha.width - 1); ++u) {
        const double weight = alpha.at(u, v, 0);
        sum += weight, at_x += weight * u, at_y += weight * v;
      }
    ASSERT_GT(sum, 0.3) << i;
    EXPECT_NEAR(at_x / sum, x, 0.5) << i;
    EXPECT_NEAR(at_y / sum, y, 0.5) << i;
  }
  const std::string text = world_file(photo);
  double lines[6];
  ASSERT_EQ(std::sscanf(text.c_str(), "%lf %lf %lf %lf %lf %lf", &lines[0], &lines[1], &lines[2],
                        &lines[3], &lines[4], &lines[5]),
            6);
  EXPECT_EQ(lines[0], kMeters);
  EXPECT_EQ(lines[3], -kMeters);
  EXPECT_NEAR(lines[4], photo.easting, 1e-6);
  EXPECT_NEAR(lines[5], photo.northing, 1e-6);
}

TEST(Orthophoto, TooManyPixelsAreRefused) {
  Gaussians gaussians(2, host_memory());
  set_gaussian(gaussians, 0, {0, 0, 0}, 1, 0.5f, Vec3f(1));
  set_gaussian(gaussians, 1, {90, 0, 0}, 1, 0.5f, Vec3f(1));
  EXPECT_THAT(error_of([&] {
                orthophoto_of(tilted_scene(), gaussians.mean.span(), {Camera()}, Vec3d(0.0), 1e-4);
              }),
              testing::HasSubstr("give more meters"));
}

}  // namespace
}  // namespace gs
