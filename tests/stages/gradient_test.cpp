// SPDX-License-Identifier: Apache-2.0
// Stages 1 to 7 together: the gradient of the whole pipeline, in float and by tiles, equals the
// slope of the brute-force picture in double, parameter by parameter.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>

#include "gs_core/math/loss/ssim.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/renderer.h"
#include "gs_render/stages.h"
#include "gs_train/backend.h"
#include "tests/support/brute_force.h"
#include "tests/support/models.h"

namespace gs {
namespace {

constexpr int kWidth = 37, kHeight = 26;  // 3 x 2 tiles, the last ones cut

/// A number computed from a picture, (3, H, W), and from the decisions that make it discontinuous,
/// as a hash.
using PictureLoss =
    std::function<double(const std::vector<double>& planes, std::uint64_t& decisions)>;

/// Gradients of all parameters, one row per Gaussian, numbers in the order of DoubleGaussian.
using Rows = std::vector<std::array<double, kNumbersPerGaussian>>;

Rows rows_of(const Gaussians& gradients) {
  Rows rows;
  for (DoubleGaussian& g : in_double(gradients)) {
    rows.emplace_back();
    for (int k = 0; k < kNumbersPerGaussian; ++k) rows.back()[k] = g.number(k);
  }
  return rows;
}

struct SmallScene {
  Camera camera = random_camera(kWidth, kHeight, 3);
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

struct Slopes {
  Rows rows;
  std::vector<std::array<bool, kNumbersPerGaussian>> is_known;
  int unknown = 0;  // the two sides took different decisions
};

/// The loss of the brute-force picture, and the decisions behind it.
double reference_loss(const std::vector<DoubleGaussian>& gaussians, const SmallScene& scene,
                      const PictureLoss& loss, std::uint64_t& decisions) {
  const ReferencePicture picture =
      reference_picture(reference_splats<double>(gaussians, scene.camera, scene.settings),
                        scene.settings, kWidth, kHeight);
  decisions = picture.decisions();
  return loss(picture.planes(), decisions);
}

/// Central differences. Their own error is h^2 times third derivatives and 1e-16 / h: some 1e-9 of
/// the largest.
Slopes slopes_of(const SmallScene& scene, const PictureLoss& loss) {
  constexpr double h = 2e-5;
  std::vector<DoubleGaussian> gaussians = in_double(scene.gaussians);
  Slopes slopes{Rows(gaussians.size()), {}, 0};
  slopes.is_known.resize(gaussians.size());
  std::uint64_t here, above, below;
  reference_loss(gaussians, scene, loss, here);
  for (std::size_t i = 0; i < gaussians.size(); ++i)
    for (int k = 0; k < kNumbersPerGaussian; ++k) {
      const double value = gaussians[i].number(k);
      gaussians[i].number(k) = value + h;
      const double high = reference_loss(gaussians, scene, loss, above);
      gaussians[i].number(k) = value - h;
      const double low = reference_loss(gaussians, scene, loss, below);
      gaussians[i].number(k) = value;
      slopes.rows[i][k] = (high - low) / (2 * h);
      slopes.is_known[i][k] = above == here && below == here;
      slopes.unknown += !slopes.is_known[i][k];
    }
  return slopes;
}

/// Parameters of one kind, in the order of DoubleGaussian.
struct Kind {
  const char* name;
  int begin, end;
};
constexpr Kind kKinds[] = {{"mean", 0, 3},
                           {"log_scale", 3, 6},
                           {"rotation", 6, 10},
                           {"logit_opacity", 10, 11},
                           {"sh0", 11, 14},
                           {"sh_rest", 14, 59},
                           {"right_rotation", 59, 63},
                           {"time_mean", 63, 64},
                           {"log_time_scale", 64, 65}};

/// Relative to the largest component of its kind. Floats round at 6e-8, and the terms of a gradient
/// (over pixels, fragments, window, conic) cancel up to two digits of that: the worst error seen is
/// 4e-6. A wrong term causes a much larger error.
constexpr double kTolerance = 3e-5;

void expect_slopes(const Rows& gradients, const Slopes& slopes) {
  // A step of 2e-5 sometimes moves the edge of a splat over a pixel center.
  EXPECT_LE(slopes.unknown, int(slopes.rows.size()) * kNumbersPerGaussian / 100);
  for (const Kind& kind : kKinds) {
    double largest = 0, worst = 0;
    for (std::size_t i = 0; i < slopes.rows.size(); ++i)
      for (int k = kind.begin; k < kind.end; ++k) {
        if (!slopes.is_known[i][k]) continue;
        largest = std::max(largest, std::abs(slopes.rows[i][k]));
        worst = std::max(worst, std::abs(slopes.rows[i][k] - gradients[i][k]));
      }
    if (largest == 0)
      EXPECT_EQ(worst, 0) << kind.name;
    else
      EXPECT_LT(worst / largest, kTolerance) << kind.name;
  }
}

/// sum_i weight_i picture_i
struct LinearLoss {
  std::vector<float> weights;
  explicit LinearLoss(std::uint64_t seed) : weights(3 * kWidth * kHeight) {
    Draws draws(seed);
    for (float& weight : weights) weight = draws.uniform(-1, 1);
  }
  double operator()(const std::vector<double>& planes, std::uint64_t&) const {
    double sum = 0;
    for (std::size_t i = 0; i < planes.size(); ++i) sum += weights[i] * planes[i];
    return sum;
  }
  Buffer<float> dL_dimage() const {
    Buffer<float> result;
    result.upload(weights);
    return result;
  }
};

void expect_gradient_of_linear_loss(const SmallScene& scene, std::uint64_t seed = 1) {
  const LinearLoss loss(seed);
  Backward result;
  forward(scene, result);
  backward(scene, loss.dL_dimage(), result);
  expect_slopes(rows_of(result.gradients), slopes_of(scene, loss));
}

TEST(Gradient, IsTheSlopeUnderTheFasterGsRule) { expect_gradient_of_linear_loss({}); }

TEST(Gradient, IsTheSlopeUnderTheClassicRuleOnBothSidesOfItsClamp) {
  SmallScene scene;
  scene.settings.blend_rule = BlendRule::classic;
  for (std::size_t i = 0; i < 4; ++i) scene.gaussians.logit_opacity[i] = logit(0.997f);
  expect_gradient_of_linear_loss(scene);
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

TEST(Gradient, IsTheSlopeAtEveryShDegree) {
  for (int degree = 0; degree < kMaxShDegree; ++degree) {
    SmallScene scene;
    scene.settings.sh_degree = degree;
    expect_gradient_of_linear_loss(scene);
  }
}

TEST(Gradient, IsTheSlopeInSpaceAndTime) {
  for (const bool antialias : {false, true}) {
    SmallScene scene;
    scene.settings.antialias = antialias;
    scene.settings.antialias_detach = false;
    scene.gaussians = in_spacetime(scene.gaussians, 41);
    scene.camera.time = 0.5f;
    expect_gradient_of_linear_loss(scene);
  }
}

TEST(Gradient, IsTheSlopeWithA3dFilter) {
  for (const bool antialias : {false, true}) {
    SmallScene scene;
    scene.settings.antialias = antialias;
    scene.settings.antialias_detach = false;
    scene.gaussians = with_filters(scene.gaussians, 44);
    expect_gradient_of_linear_loss(scene);
  }
}

TEST(Gradient, IsTheSlopeOverAnyBackground) {
  Draws draws(5);
  for (int i = 0; i < 2; ++i) {
    SmallScene scene;
    scene.settings.background = draws.uniform3(0, 1);
    expect_gradient_of_linear_loss(scene, 2 + i);
  }
}

TEST(Gradient, IsTheSlopeInAntialiasedModeWithItsFactorAttached) {
  SmallScene scene;
  scene.settings.antialias = true;
  scene.settings.antialias_detach = false;
  expect_gradient_of_linear_loss(scene);
}

TEST(Gradient, IsTheSlopeInSigmaTruncation) {
  SmallScene scene;
  scene.settings.truncation = Truncation::sigma3;
  expect_gradient_of_linear_loss(scene);
}

TEST(Gradient, IsTheSlopeWithNegativeColors) {
  SmallScene scene;
  scene.gaussians = random_gaussians(kNegativeColors, 9, scene.camera, 23);
  expect_gradient_of_linear_loss(scene);
}

TEST(Gradient, IsTheSlopeBeyondTheFrustumWhereTheJacobianIsClamped) {
  SmallScene scene;
  scene.gaussians =
      random_gaussians({.sigma_low = 10, .sigma_high = 20, .reach = 1.9f}, 9, scene.camera, 24);
  expect_gradient_of_linear_loss(scene);
}

/// L = (1 - lambda) mean|X - Y| + lambda (1 - mean SSIM), in double, by a plain 11 x 11 window.
double photometric_loss(const std::vector<double>& X, const std::vector<double>& Y, double lambda,
                        std::uint64_t& decisions) {
  const auto window = [](int d) { return double(kSsimWindow[std::abs(d)]); };
  double l1 = 0, ssim = 0;
  for (std::size_t i = 0; i < X.size(); ++i) {
    l1 += std::abs(X[i] - Y[i]);
    decisions = decisions * 31 + (X[i] > Y[i]);
  }
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        WindowMeans<double> m{};
        for (int v = std::max(y - 5, 0); v <= std::min(y + 5, kHeight - 1); ++v)
          for (int u = std::max(x - 5, 0); u <= std::min(x + 5, kWidth - 1); ++u) {
            const double w = window(u - x) * window(v - y);
            const std::size_t i = (std::size_t(c) * kHeight + v) * kWidth + u;
            m.x += w * X[i];
            m.y += w * Y[i];
            m.xx += w * X[i] * X[i];
            m.yy += w * Y[i] * Y[i];
            m.xy += w * X[i] * Y[i];
          }
        ssim += ssim_index(m);
      }
  return (1 - lambda) * l1 / double(X.size()) + lambda * (1 - ssim / double(X.size()));
}

TEST(Gradient, IsTheSlopeOfThePhotometricLoss) {
  for (const float lambda : {0.2f, 1.0f}) {
    SmallScene scene;
    scene.settings.sh_degree = 1;
    scene.gaussians = random_gaussians(kTypical, 4, scene.camera, 25);
    scene.settings.background = {0.3f, 0.6f, 0.4f};
    const View view{"", scene.camera, random_photo(kWidth, kHeight, 26)};
    std::vector<double> photo(3 * kWidth * kHeight);
    for (std::size_t i = 0; i < photo.size() / 3; ++i)
      for (int c = 0; c < 3; ++c)
        photo[c * photo.size() / 3 + i] = view.photo.pixels[3 * i + c] / 255.0;

    Backward result;
    forward(scene, result);
    const auto backend = make_scalar_backend();
    Buffer<float> dL_dimage;
    backend->loss().forward_backward(result.pass, view, {lambda}, dL_dimage);
    backward(scene, dL_dimage, result);
    const PictureLoss loss = [&](const std::vector<double>& planes, std::uint64_t& decisions) {
      return photometric_loss(planes, photo, lambda, decisions);
    };
    expect_slopes(rows_of(result.gradients), slopes_of(scene, loss));
    std::uint64_t ignored;
    EXPECT_NEAR(backend->loss().value(),
                reference_loss(in_double(scene.gaussians), scene, loss, ignored), 1e-6);
  }
}

TEST(Gradient, ByTheImagePlaneMeanIsTheSlope) {
  const SmallScene scene;
  const LinearLoss loss(6);
  Backward result;
  forward(scene, result);
  backward(scene, loss.dL_dimage(), result);

  ReferenceSplats splats =
      reference_splats<double>(in_double(scene.gaussians), scene.camera, scene.settings);
  const auto loss_and_decisions = [&](std::uint64_t& decisions) {
    const ReferencePicture picture = reference_picture(splats, scene.settings, kWidth, kHeight);
    decisions = picture.decisions();
    return loss(picture.planes(), decisions);
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
  EXPECT_LT(worst / largest, kTolerance);
}

/// The absolute gradients of each pixel by image-plane means, summed: from the slopes of each pixel
/// alone.
std::vector<Vec3d> absolute_slopes(ReferenceSplats splats, const SmallScene& scene,
                                   const LinearLoss& loss) {
  constexpr double h = 1e-4;  // pixels
  const Buffer<float> weights = loss.dL_dimage();
  const auto picture = [&] { return reference_picture(splats, scene.settings, kWidth, kHeight); };
  std::vector<Vec3d> result(scene.gaussians.count(), Vec3d(0.0));
  const std::size_t plane = std::size_t(kWidth) * kHeight;
  for (ReferenceSplats::Entry& entry : splats.entries)
    for (int axis = 0; axis < 2; ++axis) {
      const double value = entry.splat.mean2d[axis];
      entry.splat.mean2d[axis] = value + h;
      const ReferencePicture high = picture();
      entry.splat.mean2d[axis] = value - h;
      const ReferencePicture low = picture();
      entry.splat.mean2d[axis] = value;
      for (std::size_t i = 0; i < plane; ++i) {
        if (high.pixels[i].decisions != low.pixels[i].decisions) continue;  // a faint edge
        double slope = 0;
        for (int c = 0; c < 3; ++c)
          slope += double(weights[c * plane + i]) *
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
    const LinearLoss loss(6);
    Backward plain, absolute;
    forward(scene, plain);
    backward(scene, loss.dL_dimage(), plain);
    EXPECT_TRUE(plain.pass.scratch<ScalarScratch>().absolute_gradients.empty());
    scene.settings.absolute_gradient = true;
    forward(scene, absolute);
    backward(scene, loss.dL_dimage(), absolute);
    EXPECT_TRUE(same_bits(absolute.gradients, plain.gradients));  // of the parameters

    const std::vector<Vec3d> expected = absolute_slopes(
        reference_splats<double>(in_double(scene.gaussians), scene.camera, scene.settings), scene,
        loss);
    double largest = 0, worst = 0;
    bool differs = false;
    for (std::size_t i = 0; i < expected.size(); ++i)
      for (int axis = 0; axis < 2; ++axis) {
        largest = std::max(largest, expected[i][axis]);
        worst = std::max(worst, std::abs(expected[i][axis] - absolute.dL_dmean2d[i][axis]));
        EXPECT_GE(absolute.dL_dmean2d[i][axis], std::abs(plain.dL_dmean2d[i][axis]) * 0.9999f);
        differs |= absolute.dL_dmean2d[i][axis] > 1.5f * std::abs(plain.dL_dmean2d[i][axis]);
      }
    EXPECT_LT(worst / largest, kTolerance) << largest;
    EXPECT_TRUE(differs);
  }
}

bool is_zero(const Rows& rows, std::size_t i) {
  return std::all_of(rows[i].begin(), rows[i].end(), [](double value) { return value == 0; });
}

TEST(Gradient, OfInvisibleGaussiansIsExactlyZeroWhateverWasThere) {
  SmallScene scene;
  scene.gaussians = joined(random_gaussians(kBehind, 20, scene.camera, 27),
                           random_gaussians(kOffScreen, 100, scene.camera, 28));
  Backward result;
  forward(scene, result);
  result.gradients.resize(scene.gaussians.count());
  for_each_array([](const char*, const auto& array) { number_rows(array, 1); }, result.gradients);
  backward(scene, LinearLoss(7).dL_dimage(), result);
  const Rows rows = rows_of(result.gradients);
  std::size_t invisible = 0, moved = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (result.pass.tile_counts[i]) {
      // some only touch the part of a tile that lies outside of the picture
      moved += !is_zero(rows, i);
      continue;
    }
    ++invisible;
    EXPECT_TRUE(is_zero(rows, i)) << i;
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
  backward(scene, LinearLoss(8).dL_dimage(), result);
  EXPECT_GT(result.pass.tile_counts[11], 0u);
  EXPECT_TRUE(is_zero(rows_of(result.gradients), 11));
  EXPECT_FALSE(is_zero(rows_of(result.gradients), 0));
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
      backward(scene, LinearLoss(10).dL_dimage(), result);
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
    backward(scene, LinearLoss(9).dL_dimage(), result);
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
  Draws draws(31);
  std::vector<float> weights(3 * 200 * 150);
  for (float& weight : weights) weight = draws.uniform(-1, 1);
  Buffer<float> dL_dimage;
  dL_dimage.upload(weights);
  std::vector<Backward> results;
  for (const int threads : {1, 2, 3}) {
    set_thread_count(threads);
    forward(scene, results.emplace_back());
    backward(scene, dL_dimage, results.back());
  }
  set_thread_count(0);
  for (const Backward& other : {std::cref(results[1]), std::cref(results[2])}) {
    EXPECT_TRUE(same_bits(results[0].gradients, other.gradients));
    EXPECT_EQ(results[0].pass.image.download(), other.pass.image.download());
    EXPECT_EQ(results[0].dL_dmean2d.download(), other.dL_dmean2d.download());
  }
}

}  // namespace
}  // namespace gs
