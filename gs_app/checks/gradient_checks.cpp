// SPDX-License-Identifier: Apache-2.0
// The first half of `gemsplat selftest`: gradients of the scalar renderer against central
// differences of its pictures.
#include <algorithm>
#include <cmath>

#include "gs_app/checks/generated_scene.h"
#include "gs_app/checks/self_check_list.h"
#include "gs_render/renderer.h"

namespace gs {
namespace {

constexpr std::uint64_t kDirections = 16;  // for each quantity and scene

// A central difference includes fragments that appear and vanish at the rims of splats; the
// gradient does not. Here Gaussians end at four standard deviations, where they have 3e-4 of their
// height. This limits the error to some 5e-3 for quantities that move the rims. The rest is
// rounding.
constexpr double kMovingTolerance = 2e-2, kFixedTolerance = 1e-3;

/// The step of a central difference: large against the rounding of floats, small against the
/// curvature of the picture.
struct SlopeStep {
  float size;
  double tolerance;
};
template <class T>
using SlopeStepOf = SlopeStep;
constexpr GaussianArrays<SlopeStepOf> kSteps{{0.004f, kMovingTolerance},
                                             {0.01f, kMovingTolerance},
                                             {0.02f, kMovingTolerance},
                                             {0.03f, kFixedTolerance},
                                             {0.02f, kFixedTolerance},
                                             {0.01f, kFixedTolerance},
                                             true,
                                             {0.02f, kMovingTolerance},
                                             {0.01f, kMovingTolerance},
                                             {0.01f, kMovingTolerance}};

struct SmallScene {
  std::string name;
  RenderSettings settings;
  bool moves = false;
};

std::vector<SmallScene> gradient_scenes() {
  SmallScene faster_gs{"faster_gs", {}}, classic{"classic", {}}, antialias{"antialias", {}};
  classic.settings.blend_rule = BlendRule::classic;
  antialias.settings.antialias = true;
  antialias.settings.antialias_detach = false;
  antialias.settings.background = {0.2f, 0.5f, 0.8f};
  SmallScene moving{"in space and time", {}, true};
  for (SmallScene* scene : {&faster_gs, &classic, &antialias, &moving})
    scene->settings.truncation = Truncation::sigma4;
  return {faster_gs, classic, antialias, moving};
}

/// A picture of a few Gaussians and a smooth loss: the sum of its values with slowly varying
/// weights.
class SlopeCheck {
 public:
  explicit SlopeCheck(const SmallScene& small) : settings_(small.settings) {
    SceneRecipe recipe{.gaussians = 24, .width = 53, .height = 38, .views = 1};
    recipe.reach = 0.45f;
    recipe.sigma_low = 2;
    recipe.sigma_high = 6;
    recipe.opacity_high = 0.8f;
    recipe.moves = small.moves;
    GeneratedScene scene = generated_scene(recipe);
    camera_ = scene.views[0].camera;
    gaussians_ = std::move(scene.model.gaussians);
    for (Vec3f& color : gaussians_.sh0) color *= 0.5f;  // away from black, where colors are clamped
    weights_.resize_discard(std::size_t(3) * recipe.width * recipe.height);
    for (std::size_t i = 0; i < weights_.size(); ++i) weights_[i] = std::sin(0.01f * float(i));
  }

  const Gaussians& gaussians() const { return gaussians_; }

  Gaussians gradients() {
    Gaussians result = rows_like(gaussians_, gaussians_.count(), host_memory());
    Buffer<Vec2f> by_mean2d(gaussians_.count(), host_memory());
    loss();
    renderer_->backward(gaussians_.span(), camera_, settings_, pass_, weights_.span(),
                        result.span(), by_mean2d.span());
    return result;
  }

  /// The slope of the loss along `direction` in the numbers of `array`, which is one of
  /// gaussians(). It combines central differences of two steps so that their errors of second order
  /// cancel.
  template <class T>
  double slope(const Buffer<T>& array, const Numbers& direction, float step) {
    const double near = loss_at(array, direction, step) - loss_at(array, direction, -step);
    const double far = loss_at(array, direction, 2 * step) - loss_at(array, direction, -2 * step);
    return (8 * near - far) / (12.0 * step);
  }

 private:
  double loss() {
    renderer_->forward(gaussians_.span(), camera_, settings_, pass_);
    double sum = 0;
    for (std::size_t i = 0; i < weights_.size(); ++i) sum += double(weights_[i]) * pass_.image[i];
    return sum;
  }
  template <class T>
  double loss_at(const Buffer<T>& array, const Numbers& direction, float step) {
    const std::vector<T> before = array.download();
    float* const numbers = reinterpret_cast<float*>(array.data());
    for (std::size_t i = 0; i < direction.size(); ++i) numbers[i] += step * direction[i];
    const double result = loss();
    std::copy(before.begin(), before.end(), array.begin());
    return result;
  }

  RenderSettings settings_;
  Camera camera_;
  Gaussians gaussians_;
  Buffer<float> weights_;
  RenderPass pass_;
  std::unique_ptr<Renderer> renderer_ = make_scalar_renderer();
};

void check_slopes(const SmallScene& scene, SelfCheckList& checks) {
  SlopeCheck check(scene);
  const Gaussians gradients = check.gradients();
  std::uint64_t seed = 100;
  for_each_array(
      [&](const char* name, const auto& array, const auto& gradient, const SlopeStep& step) {
        const Numbers by_number = downloaded_numbers(gradient);
        Numbers expected, actual;
        for (std::uint64_t k = 0; k < kDirections; ++k) {
          const Numbers direction = random_normals(by_number.size(), ++seed);
          double sum = 0;
          for (std::size_t i = 0; i < direction.size(); ++i)
            sum += double(by_number[i]) * direction[i];
          actual.push_back(float(sum));
          expected.push_back(float(check.slope(array, direction, step.size)));
        }
        checks.add(name, scene.name, step.tolerance, actual, expected);
      },
      check.gaussians(), gradients, kSteps);
}

}  // namespace

std::vector<SelfCheck> gradient_checks() {
  SelfCheckList checks;
  for (const SmallScene& scene : gradient_scenes()) check_slopes(scene, checks);
  return checks.take();
}

}  // namespace gs
