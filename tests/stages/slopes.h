// SPDX-License-Identifier: Apache-2.0
// What tests of gradients share: the scenes on which each of them must hold, and the comparison of a
// gradient in float with central differences of a loss in double.
#pragma once

#include "tests/support/brute_force.h"
#include "tests/support/lens_scenes.h"
#include "tests/support/models.h"

namespace gs {

inline constexpr int kWidth = 37, kHeight = 26;  // 3 x 2 tiles, the last ones cut
inline constexpr std::size_t kPixels = std::size_t(kWidth) * kHeight;

/// What makes another scene of the usual one, which has nine Gaussians.
struct SceneChange {
  const char* name;
  void (*apply)(Camera& camera, RenderSettings& settings, Gaussians& gaussians);
};

inline void attach_antialiasing(RenderSettings& settings) {
  settings.antialias = true;
  settings.antialias_detach = false;
}

template <int scene>
void see_through(Camera& camera, RenderSettings&, Gaussians& gaussians) {
  const LensScene& lens = lens_scenes()[scene];
  camera = with_lens(camera, lens.model, lens.params, lens.motion);
  gaussians = at_angles(std::move(gaussians), camera, lens.least, lens.most, 27);
}

inline const SceneChange kSceneChanges[] = {
    {"nothing", [](Camera&, RenderSettings&, Gaussians&) {}},
    {"the classic rule on both sides of its clamp",
     [](Camera&, RenderSettings& settings, Gaussians& gaussians) {
       settings.blend_rule = BlendRule::classic;
       for (std::size_t i = 0; i < 4; ++i) gaussians.logit_opacity[i] = logit(0.997f);
     }},
    {"a background",
     [](Camera&, RenderSettings& settings, Gaussians&) {
       settings.background = {0.3f, 0.6f, 0.4f};
     }},
    {"SH of degree 0",
     [](Camera&, RenderSettings& settings, Gaussians&) { settings.sh_degree = 0; }},
    {"SH of degree 1",
     [](Camera&, RenderSettings& settings, Gaussians&) { settings.sh_degree = 1; }},
    {"SH of degree 2",
     [](Camera&, RenderSettings& settings, Gaussians&) { settings.sh_degree = 2; }},
    {"space and time",  // at half of its duration
     [](Camera&, RenderSettings&, Gaussians& gaussians) {
       gaussians = in_spacetime(gaussians, 41);
     }},
    {"space and time, antialiased",
     [](Camera&, RenderSettings& settings, Gaussians& gaussians) {
       attach_antialiasing(settings);
       gaussians = in_spacetime(gaussians, 41);
     }},
    {"3D filters", [](Camera&, RenderSettings&,
                      Gaussians& gaussians) { gaussians = with_filters(gaussians, 44); }},
    {"3D filters, antialiased",
     [](Camera&, RenderSettings& settings, Gaussians& gaussians) {
       attach_antialiasing(settings);
       gaussians = with_filters(gaussians, 44);
     }},
    {"antialiasing with its factor attached",
     [](Camera&, RenderSettings& settings, Gaussians&) { attach_antialiasing(settings); }},
    {"truncation by sigma", [](Camera&, RenderSettings& settings,
                               Gaussians&) { settings.truncation = Truncation::sigma3; }},
    {"negative colors",
     [](Camera& camera, RenderSettings&, Gaussians& gaussians) {
       gaussians = random_gaussians(kNegativeColors, 9, camera, 23);
     }},
    {"Gaussians beyond the frustum, where the Jacobian is clamped",
     [](Camera& camera, RenderSettings&, Gaussians& gaussians) {
       gaussians =
           random_gaussians({.sigma_low = 10, .sigma_high = 20, .reach = 1.9f}, 9, camera, 24);
     }},
    {"a strong lens", see_through<0>},
    {"a lens beyond its fold", see_through<1>},
    {"a fisheye at 80 degrees", see_through<2>},
    {"a fisheye beyond 90 degrees", see_through<3>},
    {"an equidistant fisheye", see_through<4>},
    {"a moving pinhole", see_through<5>},
    {"a moving fisheye", see_through<6>},
};

/// A camera for all of them.
inline Camera slope_camera() {
  Camera camera = random_camera(kWidth, kHeight, 3);
  camera.time = 0.5f;
  return camera;
}

/// A linear loss has these weights of all numbers of a picture, (3, H, W).
inline std::vector<float> loss_weights(std::uint64_t seed) {
  Draws draws(seed);
  std::vector<float> weights(3 * kPixels);
  for (float& weight : weights) weight = draws.uniform(-1, 1);
  return weights;
}
inline double linear_loss(const std::vector<float>& weights, const std::vector<double>& planes) {
  double sum = 0;
  for (std::size_t i = 0; i < planes.size(); ++i) sum += weights[i] * planes[i];
  return sum;
}
inline Buffer<float> uploaded(const std::vector<float>& numbers) {
  Buffer<float> result;
  result.upload(numbers);
  return result;
}

/// Parameters of one kind, in the order of DoubleGaussian.
struct ParameterKind {
  const char* name;
  int begin, end;
};
inline constexpr ParameterKind kKinds[] = {{"mean", 0, 3},
                                           {"log_scale", 3, 6},
                                           {"rotation", 6, 10},
                                           {"logit_opacity", 10, 11},
                                           {"sh0", 11, 14},
                                           {"sh_rest", 14, 59},
                                           {"right_rotation", 59, 63},
                                           {"time_mean", 63, 64},
                                           {"log_time_scale", 64, 65}};

/// How a gradient is compared.
struct SlopeRule {
  double h;             // of the central differences
  double tolerance;     // relative to the largest component of its kind
  double most_unknown;  // share of the slopes whose two sides take different decisions
  bool has_sh_rest = true;
};

/// `loss` takes the Gaussians in double, and hashes the decisions that make it discontinuous.
template <class Loss>
void expect_slopes(const Gaussians& parameters, const Gaussians& gradient, const SlopeRule& rule,
                   const Loss& loss) {
  std::vector<DoubleGaussian> gaussians = in_double(parameters), gradients = in_double(gradient);
  std::uint64_t here, above, below;
  loss(gaussians, here);
  int unknown = 0, all = 0;
  for (const ParameterKind& kind : kKinds) {
    if (!rule.has_sh_rest && kind.begin == 14) continue;
    double largest = 0, worst = 0;
    for (std::size_t i = 0; i < gaussians.size(); ++i)
      for (int k = kind.begin; k < kind.end; ++k, ++all) {
        const double value = gaussians[i].number(k);
        gaussians[i].number(k) = value + rule.h;
        const double high = loss(gaussians, above);
        gaussians[i].number(k) = value - rule.h;
        const double low = loss(gaussians, below);
        gaussians[i].number(k) = value;
        if (above != here || below != here) {
          ++unknown;
          continue;
        }
        const double slope = (high - low) / (2 * rule.h);
        largest = std::max(largest, std::abs(slope));
        worst = std::max(worst, std::abs(slope - gradients[i].number(k)));
      }
    if (largest == 0)
      EXPECT_EQ(worst, 0) << kind.name;
    else
      EXPECT_LT(worst / largest, rule.tolerance) << kind.name;
  }
  EXPECT_LE(unknown, rule.most_unknown * all);
}

}  // namespace gs
