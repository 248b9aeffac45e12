// SPDX-License-Identifier: Apache-2.0
// The picture of Gaussians in space and time at a moment is, bit for bit, what the stages of 3D make
// of the Gaussians in space that they are at that moment.
#include "gs_core/math/render/tile_bounds.h"
#include "gs_core/math/spacetime/spacetime_splat.h"
#include "gs_render/renderer.h"
#include "gs_render/stages.h"
#include "tests/support/models.h"

namespace gs {
namespace {

/// A Gaussian in space as conditioning gives it: a covariance in place of scales and a rotation.
struct Ellipsoid {
  Vec3f mean;
  Sym3<float> covariance;
  float opacity;  // 0: not alive at the moment
};

std::vector<Ellipsoid> ellipsoids_at(const Gaussians& moving, float time) {
  std::vector<Ellipsoid> ellipsoids;
  for (std::size_t i = 0; i < moving.count(); ++i) {
    const SpacetimeShape<float> shape = shape_of(spacetime_parameters_of(moving.span(), i));
    const Instant<float> moment = condition(covariance(shape), time - shape.time_mean);
    const float opacity = sigmoid(shape.logit_opacity) * moment.marginal;
    ellipsoids.push_back(
        {shape.mean + moment.shift, moment.covariance, is_alive(moment.marginal) ? opacity : 0.0f});
  }
  return ellipsoids;
}

/// Stages 1 to 4 of 3D, from ellipsoids and the colors of `colors_of`.
void render_ellipsoids(const std::vector<Ellipsoid>& ellipsoids, const Gaussians& colors_of,
                       const Camera& camera, const RenderSettings& settings, RenderPass& pass) {
  pass.background = settings.background;
  pass.begin(camera, ellipsoids.size());
  for (std::size_t i = 0; i < ellipsoids.size(); ++i) {
    const auto& [mean, covariance, opacity] = ellipsoids[i];
    pass.tile_counts[i] = 0;
    const Vec3f p = to_camera(camera, mean);
    if (opacity == 0 || !is_between_planes(p.z, settings)) continue;
    const ProjectedGaussian<float> projected =
        project_ellipsoid(camera, p, covariance, opacity, settings);
    if (!projected.is_visible) continue;
    pass.splats[i] = projected.splat;
    pass.splats[i].color = sh_color(settings.sh_degree, unit_direction(camera.position(), mean),
                                    colors_of.sh0[i], colors_of.sh_rest[i].coefficient);
    const Splat& splat = pass.splats[i];
    pass.pixel_rects[i] = pixels_of(settings.bounds, splat.mean2d, projected.cov2d, splat.cutoff,
                                    pass.tiles_x, pass.tiles_y);
    if (pass.pixel_rects[i].empty()) continue;
    for_each_hit_tile(splat.mean2d, splat.conic, tile_cutoff(settings.bounds, splat.cutoff),
                      pass.pixel_rects[i], [&](int, int) { ++pass.tile_counts[i]; });
  }
  create_instances(settings, pass);
  sort_by_tile(pass);
  blend(settings, pass);
}

TEST(RenderAtAMoment, IsThePictureOfTheConditionedGaussiansBitForBit) {
  Camera camera = random_camera(150, 110, 5);
  const Gaussians moving = in_spacetime(random_gaussians(kTypical, 2000, camera, 3), 4);
  const auto renderer = make_scalar_renderer();
  RenderPass actual, expected;
  for (const bool antialias : {false, true})
    for (const float time : {0.0f, 0.31f, 0.5f, 0.97f}) {
      SCOPED_TRACE(time);
      camera.time = time;
      RenderSettings settings;
      settings.sh_degree = 3;
      settings.antialias = antialias;
      settings.background = {0.2f, 0.4f, 0.6f};
      renderer->forward(moving.span(), camera, settings, actual);
      render_ellipsoids(ellipsoids_at(moving, time), moving, camera, settings, expected);
      EXPECT_TRUE(same_bits(actual.tile_counts, expected.tile_counts));
      EXPECT_TRUE(same_bits(actual.image, expected.image));
    }
}

// Without a turn, and at their own mean in time, Gaussians of 4D are those of 3D to the last bit.
TEST(RenderAtAMoment, OfGaussiansThatStandIsThePictureOf3dBitForBit) {
  Camera camera = random_camera(150, 110, 6);
  Gaussians still = random_gaussians(kTypical, 2000, camera, 5);
  for (std::size_t i = 0; i < still.count(); ++i) still.rotation[i] = {1, 0, 0, 0};
  Gaussians moving = in_spacetime(still, 6);
  for (std::size_t i = 0; i < still.count(); ++i) {
    moving.rotation[i] = moving.right_rotation[i] = {1, 0, 0, 0};
    moving.time_mean[i] = 0.4f;
  }
  camera.time = 0.4f;
  const auto renderer = make_scalar_renderer();
  RenderPass in_time, in_space;
  RenderSettings settings;
  settings.sh_degree = 2;
  renderer->forward(moving.span(), camera, settings, in_time);
  renderer->forward(still.span(), camera, settings, in_space);
  EXPECT_GT(in_space.tile_splats.size(), 0u);
  EXPECT_TRUE(same_bits(in_time.image, in_space.image));
}

}  // namespace
}  // namespace gs
