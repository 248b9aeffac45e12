// SPDX-License-Identifier: Apache-2.0
// Stages 1 to 7 together: the gradient of the whole pipeline, in float and by tiles, equals the
// slope of the brute-force picture in double, parameter by parameter.
#include "gs_render/renderer.h"
#include "gs_render/stages.h"
#include "tests/stages/slopes.h"

namespace gs {
namespace {

struct SmallScene {
  Camera camera = slope_camera();
  RenderSettings settings;
  Gaussians gaussians = random_gaussians(kTypical, 9, camera, 21);
};

/// The pipeline's gradients for a given dL/d(image).
struct Backward {
  RenderPass pass;
  Gaussians gradients;
  Buffer<Vec2f> dL_dmean2d;
};
void forward(const SmallScene& scene, Backward& result) {
  make_scalar_renderer()->forward(scene.gaussians.span(), scene.camera, scene.settings,
                                  result.pass);
}
void backward(const SmallScene& scene, const Buffer<float>& dL_dimage, Backward& result) {
  result.gradients.has_time = scene.gaussians.has_time;
  result.gradients.resize(scene.gaussians.count());
  result.dL_dmean2d.resize(scene.gaussians.count());
  make_scalar_renderer()->backward(scene.gaussians.span(), scene.camera, scene.settings,
                                   result.pass, dL_dimage.span(), result.gradients.span(),
                                   result.dL_dmean2d.span());
}

/// Floats round at 6e-8, and the terms of a gradient (over pixels, fragments, window, conic) cancel
/// up to two digits of that: the worst error seen is 4e-6. A wrong term causes a much larger error.
constexpr double kGradientTolerance = 3e-5;

/// Central differences have an error of h^2 times third derivatives and 1e-16 / h: some 1e-9 of the
/// largest. A step sometimes moves the edge of a splat over a pixel center.
void expect_gradient_of_linear_loss(const SmallScene& scene) {
  const std::vector<float> weights = loss_weights(1);
  Backward result;
  forward(scene, result);
  backward(scene, uploaded(weights), result);
  expect_slopes(scene.gaussians, result.gradients, {2e-5, kGradientTolerance, 0.01},
                [&](const std::vector<DoubleGaussian>& gaussians, std::uint64_t& decisions) {
                  const ReferencePicture picture = reference_picture(
                      reference_splats<double>(gaussians, scene.camera, scene.settings),
                      scene.settings, kWidth, kHeight);
                  decisions = picture.decisions();
                  return linear_loss(weights, picture.planes());
                });
}

TEST(Gradient, IsTheSlopeInEveryScene) {
  for (const SceneChange& change : kSceneChanges) {
    SCOPED_TRACE(change.name);
    SmallScene scene;
    change.apply(scene.camera, scene.settings, scene.gaussians);
    expect_gradient_of_linear_loss(scene);
  }
}

TEST(Gradient, IsTheSlopeWherePixelsBecomeOpaque) {
  for (const BlendRule rule : {BlendRule::faster_gs, BlendRule::classic}) {
    SmallScene scene;
    scene.settings.blend_rule = rule;
    scene.gaussians = random_gaussians(
        {.sigma_low = 6, .sigma_high = 20, .opacity_low = 0.8f, .opacity_high = 0.999f}, 14,
        scene.camera, 22);
    Backward result;
    forward(scene, result);
    const auto& T = result.pass.transmittance;
    EXPECT_GT(std::count_if(T.begin(), T.end(), [](float t) { return t < 2 * kMinTransmittance; }),
              20);
    expect_gradient_of_linear_loss(scene);
  }
}

TEST(Gradient, ByTheImagePlaneMeanIsTheSlope) {
  const SmallScene scene;
  const std::vector<float> weights = loss_weights(6);
  Backward result;
  forward(scene, result);
  backward(scene, uploaded(weights), result);

  ReferenceSplats splats =
      reference_splats<double>(in_double(scene.gaussians), scene.camera, scene.settings);
  const auto loss_and_decisions = [&](std::uint64_t& decisions) {
    const ReferencePicture picture = reference_picture(splats, scene.settings, kWidth, kHeight);
    decisions = picture.decisions();
    return linear_loss(weights, picture.planes());
  };
  constexpr double h = 1e-4;  // pixels
  double largest = 0, worst = 0;
  int unknown = 0;
  for (ReferenceSplats::Entry& entry : splats.entries)
    for (int axis = 0; axis < 2; ++axis) {
      const double value = entry.splat.mean2d[axis];
      std::uint64_t above, below;
      entry.splat.mean2d[axis] = value + h;
      const double high = loss_and_decisions(above);
      entry.splat.mean2d[axis] = value - h;
      const double low = loss_and_decisions(below);
      entry.splat.mean2d[axis] = value;
      if (above != below) {
        ++unknown;
        continue;
      }
      const double slope = (high - low) / (2 * h);
      largest = std::max(largest, std::abs(slope));
      worst = std::max(worst, std::abs(slope - result.dL_dmean2d[entry.gaussian][axis]));
    }
  EXPECT_LE(unknown, 4);
  EXPECT_LT(worst / largest, kGradientTolerance);
}

/// The absolute gradients of each pixel by image-plane means, summed: from the slopes of each pixel
/// alone.
std::vector<Vec3d> absolute_slopes(ReferenceSplats splats, const SmallScene& scene,
                                   const std::vector<float>& weights) {
  constexpr double h = 1e-4;  // pixels
  const auto picture = [&] { return reference_picture(splats, scene.settings, kWidth, kHeight); };
  std::vector<Vec3d> result(scene.gaussians.count(), Vec3d(0.0));
  for (ReferenceSplats::Entry& entry : splats.entries)
    for (int axis = 0; axis < 2; ++axis) {
      const double value = entry.splat.mean2d[axis];
      entry.splat.mean2d[axis] = value + h;
      const ReferencePicture high = picture();
      entry.splat.mean2d[axis] = value - h;
      const ReferencePicture low = picture();
      entry.splat.mean2d[axis] = value;
      for (std::size_t i = 0; i < kPixels; ++i) {
        if (high.pixels[i].decisions != low.pixels[i].decisions) continue;  // a faint edge
        double slope = 0;
        for (int c = 0; c < 3; ++c)
          slope += double(weights[c * kPixels + i]) *
                   (high.pixels[i].color[c] - low.pixels[i].color[c]) / (2 * h);
        result[entry.gaussian][axis] += std::abs(slope);
      }
    }
  return result;
}

TEST(Gradient, ByTheImagePlaneMeanSumsAbsoluteSlopesOfPixelsWhereAsked) {
  for (const BlendRule rule : {BlendRule::faster_gs, BlendRule::classic}) {
    SmallScene scene;
    scene.settings.blend_rule = rule;
    const std::vector<float> weights = loss_weights(6);
    Backward plain, absolute;
    forward(scene, plain);
    backward(scene, uploaded(weights), plain);
    EXPECT_TRUE(plain.pass.scratch<ScalarScratch>().absolute_gradients.empty());
    scene.settings.absolute_gradient = true;
    forward(scene, absolute);
    backward(scene, uploaded(weights), absolute);
    EXPECT_TRUE(same_bits(absolute.gradients, plain.gradients));  // of the parameters

    const std::vector<Vec3d> expected = absolute_slopes(
        reference_splats<double>(in_double(scene.gaussians), scene.camera, scene.settings), scene,
        weights);
    double largest = 0, worst = 0;
    bool differs = false;
    for (std::size_t i = 0; i < expected.size(); ++i)
      for (int axis = 0; axis < 2; ++axis) {
        largest = std::max(largest, expected[i][axis]);
        worst = std::max(worst, std::abs(expected[i][axis] - absolute.dL_dmean2d[i][axis]));
        EXPECT_GE(absolute.dL_dmean2d[i][axis], std::abs(plain.dL_dmean2d[i][axis]) * 0.9999f);
        differs |= absolute.dL_dmean2d[i][axis] > 1.5f * std::abs(plain.dL_dmean2d[i][axis]);
      }
    EXPECT_LT(worst / largest, kGradientTolerance) << largest;
    EXPECT_TRUE(differs);
  }
}

bool is_zero(const Gaussians& rows, std::size_t i) {
  bool is_zero = true;
  for_each_array([&](const char*, const auto& array) { is_zero &= row_is(array, i, 0); }, rows);
  return is_zero;
}

TEST(Gradient, OfInvisibleGaussiansIsExactlyZeroWhateverWasThere) {
  SmallScene scene;
  scene.gaussians = joined(random_gaussians(kBehind, 20, scene.camera, 27),
                           random_gaussians(kOffScreen, 100, scene.camera, 28));
  Backward result;
  forward(scene, result);
  result.gradients.resize(scene.gaussians.count());
  for_each_array([](const char*, const auto& array) { number_rows(array, 1); }, result.gradients);
  backward(scene, uploaded(loss_weights(7)), result);
  std::size_t invisible = 0, moved = 0;
  for (std::size_t i = 0; i < scene.gaussians.count(); ++i) {
    if (result.pass.tile_counts[i]) {
      // some only touch the part of a tile that lies outside of the picture
      moved += !is_zero(result.gradients, i);
      continue;
    }
    ++invisible;
    EXPECT_TRUE(is_zero(result.gradients, i)) << i;
    EXPECT_EQ(result.dL_dmean2d[i], Vec2f(0.0f)) << i;
  }
  EXPECT_GT(invisible, 40u);
  EXPECT_GT(moved, 5u);
}

TEST(Gradient, OfAVisibleGaussianBehindOpaqueOnesIsZero) {
  SmallScene scene;
  scene.gaussians.resize(12);
  for (std::size_t i = 0; i < 12; ++i)
    set_gaussian(scene.gaussians, i, behind_pixel(scene.camera, 18, 13, 1 + 0.2f * float(i)), 50,
                 0.95f);
  Backward result;
  forward(scene, result);
  backward(scene, uploaded(loss_weights(8)), result);
  EXPECT_GT(result.pass.tile_counts[11], 0u);
  EXPECT_TRUE(is_zero(result.gradients, 11));
  EXPECT_FALSE(is_zero(result.gradients, 0));
}

TEST(Gradient, StaysFiniteForGaussiansWithoutExtentAndOfOpacityOne) {
  for (const BlendRule rule : {BlendRule::faster_gs, BlendRule::classic})
    for (const bool antialias : {false, true}) {
      SmallScene scene;
      scene.camera = plain_camera(kWidth, kHeight);
      scene.settings.blend_rule = rule;
      scene.settings.antialias = antialias;
      scene.settings.antialias_detach = false;
      scene.settings.background = {0.2f, 0.5f, 0.8f};
      scene.gaussians.resize(6);
      for (std::size_t i = 0; i < 6; ++i)
        set_gaussian(scene.gaussians, i, behind_pixel(scene.camera, 8.5f, 8.5f, 1 + float(i)), 0.1f,
                     0.5f);
      constexpr float kInfinity = std::numeric_limits<float>::infinity();
      scene.gaussians.log_scale[1] = Vec3f(-kInfinity);
      scene.gaussians.log_scale[2].y = -69;
      scene.gaussians.logit_opacity[3] = kInfinity;  // alpha is exactly 1 at its center
      Backward result;
      forward(scene, result);
      backward(scene, uploaded(loss_weights(10)), result);
      EXPECT_GT(result.pass.tile_counts[3], 0u);
      for_each_array(
          [](const char* name, const auto& array) {
            for (const float number : numbers_of(array)) EXPECT_TRUE(std::isfinite(number)) << name;
          },
          result.gradients);
    }
}

TEST(Gradient, OfShDegreesNotInUseIsZero) {
  for (int degree = 0; degree <= kMaxShDegree; ++degree) {
    SmallScene scene;
    scene.settings.sh_degree = degree;
    Backward result;
    forward(scene, result);
    backward(scene, uploaded(loss_weights(9)), result);
    for (int k = 0; k < kShRestCount; ++k) {
      float largest = 0;
      for (const ShRest& row : result.gradients.sh_rest)
        largest = std::max(largest, std::abs(row.coefficient[k].x));
      EXPECT_EQ(largest > 0, k < sh_rest_count(degree)) << degree << " " << k;
    }
  }
}

TEST(Gradient, IsTheSameToTheLastBitForAnyNumberOfThreads) {
  SmallScene scene;
  scene.camera = random_camera(200, 150);
  scene.gaussians = joined(mixed_gaussians(500, scene.camera, 29),
                           random_gaussians(kTypical, 5000, scene.camera, 30));
  std::vector<float> weights(3 * 200 * 150);
  Draws draws(31);
  for (float& weight : weights) weight = draws.uniform(-1, 1);
  const Buffer<float> dL_dimage = uploaded(weights);
  const auto results = [&] {
    Backward result;
    forward(scene, result);
    backward(scene, dL_dimage, result);
    return result;
  };
  const Backward one = with_threads(1, results);
  for (const int threads : {2, 3}) {
    const Backward other = with_threads(threads, results);
    EXPECT_TRUE(same_bits(one.gradients, other.gradients));
    EXPECT_EQ(one.pass.image.download(), other.pass.image.download());
    EXPECT_EQ(one.dL_dmean2d.download(), other.dL_dmean2d.download());
  }
}

}  // namespace
}  // namespace gs
