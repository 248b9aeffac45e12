// SPDX-License-Identifier: Apache-2.0
// Surfaces of the GPU against those of the CPU. Blocks, voxels and normals have the same bytes for
// the same depth. Depth is that of other exponentials and sums, so that single pixels differ.
#include <cstring>

#include "gs_render/fusion/fusion.h"
#include "gs_render/fusion/marching_cubes.h"
#include "tests/support/cuda.h"
#include "tests/support/surfaces.h"

namespace gs {
namespace {

class CudaFusion : public CudaTest {
 protected:
  std::unique_ptr<Fusion> on_gpu_with(const FusionRule& rule) {
    return gpu().renderer().fusion(rule);
  }
};

void expect_same_volumes(Fusion& actual, Fusion& expected, float voxel) {
  ASSERT_EQ(actual.views().size(), expected.views().size());
  ASSERT_EQ(actual.median_pixel(), expected.median_pixel());
  const Volume a = actual.fuse(actual.frame(voxel)), b = expected.fuse(expected.frame(voxel));
  ASSERT_GT(b.keys.size(), 100u);
  EXPECT_EQ(a.keys, b.keys);
  ASSERT_EQ(a.distance.size(), b.distance.size());
  // As bytes, since there are NaNs among them.
  EXPECT_EQ(std::memcmp(a.distance.data(), b.distance.data(), b.distance.size() * sizeof(float)),
            0);
  const TriangleMesh mesh = surface_of(a), expected_mesh = surface_of(b);
  EXPECT_EQ(mesh.vertices, expected_mesh.vertices);
  EXPECT_EQ(mesh.triangles, expected_mesh.triangles);
}

// More views than a warp has lanes; some pixels know nothing, and one view has a wall in front.
TEST_F(CudaFusion, VoxelsOfGivenViewsHaveTheBytesOfTheCpu) {
  std::vector<DepthView> views = views_of(trace_sphere, directions(40));
  for (int y = 20; y < 40; ++y)
    for (int x = 20; x < 40; ++x) {
      views[7].inverse_depth.at(x, y, 0) = 1 / 1.5f;
      views[9].inverse_depth.at(x, y, 0) = kUnknownDepth;
    }
  for (const bool is_watertight : {false, true}) {
    const FusionRule rule{4, is_watertight};
    const auto fusion = on_gpu_with(rule);
    Fusion expected(rule);
    for (const DepthView& view : views) fusion->add(view), expected.add(view);
    expect_same_volumes(*fusion, expected, 0.03f);
  }
}

TEST_F(CudaFusion, ForgetsThePixelsThatTheCpuForgets) {
  std::vector<DepthView> views = views_of(trace_sphere, directions(20));
  for (int y = 20; y < 40; ++y)
    for (int x = 20; x < 40; ++x) views[7].inverse_depth.at(x, y, 0) = 1 / 1.5f;
  const auto fusion = on_gpu_with({});
  Fusion expected({});
  for (const DepthView& view : views) fusion->add(view), expected.add(view);
  fusion->drop_doubtful();
  expected.drop_doubtful();
  EXPECT_EQ(expected.views()[7].inverse_depth.at(30, 30, 0), kUnknownDepth);
  for (std::size_t v = 0; v < views.size(); ++v)
    EXPECT_EQ(fusion->views()[v].inverse_depth.pixels, expected.views()[v].inverse_depth.pixels);
  expect_same_volumes(*fusion, expected, 0.03f);
}

TEST_F(CudaFusion, FramesBeyondItsMarksAreMarkedOnTheCpu) {
  const auto fusion = on_gpu_with({});
  Fusion expected({});
  for (const DepthView& view : views_of(trace_sphere, directions(2)))
    fusion->add(view), expected.add(view);
  VolumeFrame wide = expected.frame(0.03f);
  for (std::uint64_t& blocks : wide.blocks) blocks = 4000;
  EXPECT_EQ(fusion->surface_blocks(wide), expected.surface_blocks(wide));
}

TEST_F(CudaFusion, DepthOfAModelIsThatOfTheCpuAndItsVoxelsHaveTheSameBytes) {
  const Gaussians model = sphere_of_gaussians(), there = on_gpu(model);
  RenderSettings settings;
  for (const BlendRule rule : {BlendRule::faster_gs, BlendRule::classic}) {
    settings.blend_rule = rule;
    const auto fusion = on_gpu_with({});
    Fusion scalar({}), same_depth({});
    RenderPass pass(gpu().memory()), scalar_pass;
    for (const Vec3f& direction : directions(8)) {
      const Camera camera = camera_from(direction);
      gpu().renderer().forward(there.span(), camera, settings, pass);
      fusion->add(there.span(), camera, settings, pass, gpu().renderer().picture_of(pass));
      cpu().renderer().forward(model.span(), camera, settings, scalar_pass);
      scalar.add(model.span(), camera, settings, scalar_pass,
                 cpu().renderer().picture_of(scalar_pass));
    }
    std::size_t pixels = 0, surface = 0, other_kind = 0, other_depth = 0;
    for (std::size_t v = 0; v < scalar.views().size(); ++v) {
      const DepthView &a = fusion->views()[v], &b = scalar.views()[v];
      for (std::size_t i = 0; i < b.inverse_depth.pixels.size(); ++i) {
        const float o = a.inverse_depth.pixels[i], expected = b.inverse_depth.pixels[i];
        ++pixels;
        other_kind += (o > 0) != (expected > 0) || (o < 0) != (expected < 0);
        if (!(o > 0 && expected > 0)) continue;
        ++surface;
        other_depth += !(std::abs(o - expected) <= 1e-4f * expected);
      }
      const DepthView again = depth_view(a.camera, a.inverse_depth, a.color);
      EXPECT_EQ(again.facing, a.facing);
      same_depth.add(again);
    }
    EXPECT_GT(surface, pixels / 4);
    EXPECT_LE(other_kind, pixels / 1000);
    EXPECT_LE(other_depth, surface / 500);  // where another fragment is that of half the light
    expect_same_volumes(*fusion, same_depth, 0.04f);
  }
}

}  // namespace
}  // namespace gs
