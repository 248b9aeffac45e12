// SPDX-License-Identifier: Apache-2.0
// Ellipsoids project as their Gaussians do, and a box outside of a view hides nothing.
#include "gs_core/math/view/view_box.h"

#include "tests/support/scenes.h"

namespace gs {
namespace {

Ellipsoid ellipsoid_at(const Gaussians& rows, std::size_t i) {
  return ellipsoid_of(rows.mean[i], rows.log_scale[i], rows.rotation[i], rows.logit_opacity[i],
                      rows.has_filter ? rows.filter_scale[i] : 0.0f);
}

ProjectedGaussian<float> projected_at(const Gaussians& rows, std::size_t i, const Camera& camera,
                                      const SplatSettings& settings) {
  return project_shape(camera, rows.mean[i], rows.log_scale[i], rows.rotation[i],
                       rows.logit_opacity[i], rows.has_filter ? rows.filter_scale[i] : 0.0f,
                       settings);
}

constexpr Recipe kRecipes[] = {kTypical, kSharp, kNeedles, kHuge, kFaint, kOffScreen, kBehind};

bool is_drawn(const ProjectedGaussian<float>& projected, const Camera& camera,
              const SplatSettings& settings) {
  const int tiles_x = (camera.width + kTileWidth - 1) / kTileWidth,
            tiles_y = (camera.height + kTileHeight - 1) / kTileHeight;
  return projected.is_visible &&
         !pixels_of(settings.bounds, projected.splat.mean2d, projected.cov2d,
                    projected.splat.cutoff, tiles_x, tiles_y)
              .empty();
}

TEST(Ellipsoid, ProjectsAsItsGaussianToTheLastBit) {
  const Camera camera = random_camera(160, 120, 3);
  std::uint64_t seed = 0;
  for (const Recipe& recipe : kRecipes)
    for (const bool has_filter : {false, true}) {
      Gaussians rows = random_gaussians(recipe, 1000, camera, ++seed);
      if (has_filter) rows = with_filters(rows, seed);
      rows.rotation[5] = {0, 0, 0, 0};
      SplatSettings settings;
      settings.antialias = seed % 2;
      for (std::size_t i = 0; i < rows.count(); ++i) {
        const auto expected = projected_at(rows, i, camera, settings),
                   actual = project_shape(camera, ellipsoid_at(rows, i), settings);
        ASSERT_EQ(actual.is_visible, expected.is_visible);
        if (!expected.is_visible) continue;
        EXPECT_EQ(actual.depth, expected.depth);
        EXPECT_EQ(std::memcmp(&actual.cov2d, &expected.cov2d, sizeof actual.cov2d), 0);
        const Splat &a = actual.splat, &b = expected.splat;
        EXPECT_EQ(a.mean2d, b.mean2d);
        EXPECT_EQ(std::memcmp(&a.conic, &b.conic, sizeof a.conic), 0);
        EXPECT_EQ(a.opacity, b.opacity);
        EXPECT_EQ(a.cutoff, b.cutoff);
        EXPECT_EQ(a.variance_y, b.variance_y);
      }
    }
}

// Boxes of one Gaussian are the strictest test. Cameras stand in the scene and look anywhere.
TEST(ViewBox, WhatIsOutsideIsNotDrawn) {
  const Camera front = random_camera(640, 480, 3);
  std::size_t outside = 0, drawn = 0;
  std::uint64_t seed = 0;
  for (const Recipe& recipe : kRecipes)
    for (const auto truncation : {Truncation::alpha, Truncation::sigma3})
      for (const bool antialias : {false, true}) {
        const Gaussians rows = random_gaussians(recipe, 2000, front, ++seed);
        SplatSettings settings;
        settings.truncation = truncation;
        settings.antialias = antialias;
        for (int k = 0; k < 12; ++k) {
          Camera camera = random_camera(k % 3 ? 640 : 90, k % 2 ? 480 : 35, ++seed);
          if (k >= 4) {  // inside
            const Vec3f eye = rows.mean[seed % rows.count()];
            camera.cam_from_world_translation = -multiply(camera.cam_from_world_rotation, eye);
          }
          if (k >= 8) camera.cx = -0.5f * float(camera.width);  // off center
          for (std::size_t i = 0; i < rows.count(); ++i) {
            const Ellipsoid ellipsoid = ellipsoid_at(rows, i);
            const bool is_outside = is_box_outside(camera, settings, box_of(ellipsoid));
            const bool draws =
                is_drawn(project_shape(camera, ellipsoid, settings), camera, settings);
            ASSERT_FALSE(is_outside && draws) << "seed " << seed << ", row " << i;
            outside += is_outside;
            drawn += draws;
          }
        }
      }
  EXPECT_GT(outside, drawn / 4);  // the test is not empty
}

TEST(ViewBox, ABoxOfManyHidesNothing) {
  const Camera front = random_camera(640, 480, 3);
  const Gaussians rows = random_gaussians(kTypical, 4000, front, 1);
  const SplatSettings settings;
  std::size_t outside = 0;
  for (std::uint64_t seed = 1; seed < 40; ++seed) {
    Camera camera = random_camera(640, 480, seed);
    camera.cam_from_world_translation = -multiply(camera.cam_from_world_rotation, rows.mean[seed]);
    for (std::size_t first = 0; first + 8 <= rows.count(); first += 8) {
      Box3 box = kEmptyBox;
      bool draws = false;
      for (std::size_t i = first; i < first + 8; ++i) {
        const Ellipsoid ellipsoid = ellipsoid_at(rows, i);
        box = joined(box, box_of(ellipsoid));
        draws = draws || is_drawn(project_shape(camera, ellipsoid, settings), camera, settings);
      }
      const bool is_outside = is_box_outside(camera, settings, box);
      ASSERT_FALSE(is_outside && draws);
      outside += is_outside;
    }
  }
  EXPECT_GT(outside, 0u);
}

TEST(ViewBox, ABoxBehindTheCameraOrBeyondTheFarPlaneIsOutside) {
  const Camera camera = plain_camera(64, 48);
  const auto box_at = [&](float depth) {
    const Vec3f center = behind_pixel(camera, 32, 24, depth), half(0.1f);
    return Box3{center - half, center + half};
  };
  const SplatSettings settings;
  EXPECT_FALSE(is_box_outside(camera, settings, box_at(3)));
  EXPECT_TRUE(is_box_outside(camera, settings, box_at(-3)));
  EXPECT_TRUE(is_box_outside(camera, settings, box_at(2e4f)));
  EXPECT_FALSE(is_box_outside(camera, settings, box_at(0.25f)));
}

TEST(ViewBox, WiderSplatsAreNotTested) {
  const Camera camera = plain_camera(64, 48);
  const Box3 behind{{-1, -1, -9}, {1, 1, -8}};
  SplatSettings settings;
  settings.truncation = Truncation::sigma4;
  EXPECT_FALSE(is_box_outside(camera, settings, behind));
  settings.truncation = Truncation::alpha;
  settings.bounds = TileBounds::square;
  EXPECT_FALSE(is_box_outside(camera, settings, behind));
}

TEST(ViewBox, NumbersThatAreNotFiniteMakeNoBox) {
  Gaussians rows = random_gaussians(kTypical, 4, plain_camera(64, 48), 1);
  rows.mean[0].x = std::numeric_limits<float>::quiet_NaN();
  rows.log_scale[1] = Vec3f(std::log(1e30f));
  rows.rotation[2] = {0, 0, 0, 0};
  for (std::size_t i = 0; i < 3; ++i) {
    const Box3 box = box_of(ellipsoid_at(rows, i));
    EXPECT_GT(box.low.x, box.high.x) << i;
  }
}

}  // namespace
}  // namespace gs
