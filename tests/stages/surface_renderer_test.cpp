// SPDX-License-Identifier: Apache-2.0
// Depth, alpha and normals of Gaussians with known results.
#include "gs_render/surface_renderer.h"

#include "tests/support/scenes.h"

namespace gs {
namespace {

constexpr int kSide = 32;  // pixels

Camera centered_camera() {
  Camera camera = plain_camera(kSide, kSide);
  camera.cx = camera.cy = kSide / 2;
  return camera;
}

class Surface : public ::testing::Test {
 protected:
  SurfaceRenderer surface(const Gaussians& gaussians, const RenderSettings& settings = {}) {
    return {*renderer_, gaussians.span(), gaussians, settings};
  }
  const std::unique_ptr<Renderer> renderer_ = make_scalar_renderer();
};

TEST_F(Surface, DepthOfOneGaussianIsThatOfItsCenterAndNothingIsZero) {
  Gaussians one(1, host_memory());
  set_gaussian(one, 0, {0, 0, 5}, 0.1f, 0.9f);
  const ImageF depth = surface(one).depth(centered_camera());
  EXPECT_NEAR(depth.at(kSide / 2, kSide / 2, 0), 5, 1e-5);
  EXPECT_EQ(depth.at(0, 0, 0), 0);
}

// At (15.5, 15.5), half a pixel from both centers, a Gaussian of 20 pixels has 99.97 % of its
// opacity.
TEST_F(Surface, DepthIsTheMeanByTheWeightsOfBlending) {
  Gaussians two(2, host_memory());
  set_gaussian(two, 0, {0, 0, 2}, 0.625f, 0.5f);
  set_gaussian(two, 1, {0, 0, 8}, 2.5f, 0.8f);
  const ImageF depth = surface(two).depth(centered_camera());
  const double near = 0.5, far = 0.5 * 0.8;
  EXPECT_NEAR(depth.at(kSide / 2, kSide / 2, 0), (near * 2 + far * 8) / (near + far), 5e-3);
}

TEST_F(Surface, AlphaIsOneMinusTheTransmittance) {
  Gaussians one(1, host_memory());
  set_gaussian(one, 0, {0, 0, 5}, 1, 0.75f);
  RenderPass pass;
  renderer_->forward(one.span(), centered_camera(), {}, pass);
  const ImageF alpha = alpha_of(pass);
  EXPECT_EQ(alpha.channels, 1);
  // half a pixel from the center of a Gaussian of 12.8 pixels
  EXPECT_NEAR(alpha.at(kSide / 2, kSide / 2, 0), 0.75, 2e-3);
}

// The weights are those of the picture. With Gaussians of one depth each, the result lies between
// these depths whatever covers what.
TEST_F(Surface, DepthLiesBetweenTheNearestAndTheFarthestForAnySettings) {
  const Camera camera = random_camera(64, 48, 3);
  Recipe recipe = kTypical;
  recipe.depth_low = 2, recipe.depth_high = 3;
  const Gaussians gaussians = random_gaussians(recipe, 300, camera, 4);
  for (const bool antialias : {false, true}) {
    RenderSettings settings;
    settings.antialias = antialias;
    settings.background = Vec3f(1);
    settings.blend_rule = antialias ? BlendRule::classic : BlendRule::faster_gs;
    const ImageF depth = surface(gaussians, settings).depth(camera);
    int seen = 0;
    for (const float z : depth.pixels) {
      if (z == 0) continue;
      ++seen;
      EXPECT_GT(z, 2 - 1e-4f);
      EXPECT_LT(z, 3 + 1e-4f);
    }
    EXPECT_GT(seen, 1000);
  }
}

// Differences between points of a plane lie in it, whatever the perspective. Differences of floats
// of some 3 over 64 pixels have 5 digits.
TEST(NormalsOf, APlaneAreItsOwnUpToItsEdges) {
  const Camera camera = random_camera(64, 48, 7);
  for (const Vec3f& slope : {Vec3f(0, 0, -1), Vec3f(0.6f, 0, -0.8f), Vec3f(-0.48f, 0.64f, -0.6f)}) {
    ImageF depth(64, 48, 1);
    for (int y = 0; y < 48; ++y)
      for (int x = 0; x < 64; ++x) {
        const Vec3f ray{(float(x) + 0.5f - camera.cx) / camera.fx,
                        (float(y) + 0.5f - camera.cy) / camera.fy, 1};
        const float z = -3 / inner(slope, ray);  // the plane <slope, p> = -3
        depth.at(x, y, 0) = z > 0 ? z : 0;
      }
    const ImageF normals = normals_of(depth, camera);
    const Vec3f expected = multiply_transposed(camera.cam_from_world_rotation, slope);
    int seen = 0;
    for (int y = 0; y < 48; ++y)
      for (int x = 0; x < 64; ++x) {
        if (!(depth.at(x, y, 0) > 0 && depth.at(x, y, 0) < 20)) continue;
        ++seen;
        for (int c = 0; c < 3; ++c)
          EXPECT_NEAR(normals.at(x, y, c), expected[c], 1e-3) << x << " " << y;
      }
    EXPECT_GT(seen, 1000);
  }
}

TEST(NormalsOf, NothingAndALonePixelAreZero) {
  ImageF depth(5, 5, 1);
  depth.at(2, 2, 0) = 3;
  for (const float value : normals_of(depth, centered_camera()).pixels) EXPECT_EQ(value, 0);
}

TEST_F(Surface, NormalsHaveLengthOneWhereSomethingIs) {
  const Camera camera = random_camera(64, 48, 5);
  const Gaussians gaussians = random_gaussians(kTypical, 50, camera, 6);
  SurfaceRenderer renderer = surface(gaussians);
  const ImageF depth = renderer.depth(camera), normals = normals_of(depth, camera);
  int nothing = 0;
  for (std::size_t i = 0; i < depth.pixels.size(); ++i) {
    const float* n = &normals.pixels[3 * i];
    const float squared = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    EXPECT_TRUE(squared == 0 || std::abs(squared - 1) < 1e-5) << squared;
    nothing += squared == 0;
  }
  EXPECT_GT(nothing, 0);
  EXPECT_LT(nothing, 3000);  // of 3072
}

TEST(NormalsInCamera, AreRightUpAndTowardsIt) {
  Camera camera = centered_camera();  // looks along z, y down
  ImageF normals(3, 1, 3);
  const Vec3f world[] = {{1, 0, 0}, {0, -1, 0}, {0, 0, -1}};
  for (int x = 0; x < 3; ++x)
    for (int c = 0; c < 3; ++c) normals.at(x, 0, c) = world[x][c];
  const ImageF seen = normals_in_camera(normals, camera);
  for (int x = 0; x < 3; ++x)
    for (int c = 0; c < 3; ++c) EXPECT_EQ(seen.at(x, 0, c), x == c ? 1 : 0);
}

}  // namespace
}  // namespace gs
