// SPDX-License-Identifier: Apache-2.0
// The exact renderer: its gradients beside Jets, input by input, and its picture beside the
// brute-force one.
#include "gs_render/exact/exact_renderer.h"

#include "gs_render/exact/dual.h"
#include "gs_render/stages.h"
#include "tests/support/brute_force.h"
#include "tests/support/exact_inputs.h"
#include "tests/support/jet_oracle.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

using Jet = ceres::Jet<double, 1>;
constexpr int kExactWidth = 12, kExactHeight = 9;
constexpr InputShape kShapes[] = {{3, 0, false, false}, {2, 5, false, true},
                                  {1, 1, true, false},  {0, 40, false, false},
                                  {-1, 3, true, true},  {-1, 0, false, false}};
// Slopes of a picture sum some thousand terms, each rounded at 1e-16, which cancel.
constexpr double kSlopeTolerance = 1e-9;

/// Calls f(name, number) for each number of every input, in the same order for every scalar.
template <class Inputs, class F>
void for_each_number(Inputs& in, F&& f) {
  const auto vec3s = [&](const char* name, auto& vectors) {
    for (auto& v : vectors) f(name, v.x), f(name, v.y), f(name, v.z);
  };
  vec3s("means", in.gaussians.means);
  for (auto& q : in.gaussians.rotations)
    f("rotations", q.w), f("rotations", q.x), f("rotations", q.y), f("rotations", q.z);
  vec3s("log_scales", in.gaussians.log_scales);
  for (auto& S : in.gaussians.covariances)
    for (auto* number : {&S.xx, &S.xy, &S.xz, &S.yy, &S.yz, &S.zz}) f("covariances", *number);
  for (auto& opacity : in.gaussians.opacities) f("opacities", opacity);
  vec3s("colors", in.gaussians.colors);
  vec3s("sh", in.gaussians.sh);
  for (auto& feature : in.gaussians.features) f("features", feature);
  auto& camera = in.view.camera;
  for (auto* row : {&camera.cam_from_world_rotation.row0, &camera.cam_from_world_rotation.row1,
                    &camera.cam_from_world_rotation.row2, &camera.cam_from_world_translation})
    f("viewmat", row->x), f("viewmat", row->y), f("viewmat", row->z);
  f("intrinsics", camera.fx), f("intrinsics", camera.fy);
  f("intrinsics", camera.cx), f("intrinsics", camera.cy);
  for (auto* number : {&in.view.background.x, &in.view.background.y, &in.view.background.z})
    f("background", *number);
  for (auto& offset : in.view.screen) f("screen", offset.x), f("screen", offset.y);
}
constexpr const char* kNames[] = {"means",     "rotations",  "log_scales", "covariances",
                                  "opacities", "colors",     "sh",         "features",
                                  "viewmat",   "intrinsics", "background", "screen"};

/// The gradients in the shape of the inputs.
ExactInputs<double> as_inputs(const ExactGradients& gradients) {
  ExactInputs<double> in{static_cast<const ExactGaussians<double>&>(gradients), {}};
  in.view.camera.cam_from_world_rotation = gradients.camera.rotation;
  in.view.camera.cam_from_world_translation = gradients.camera.translation;
  in.view.camera.fx = gradients.camera.fx;
  in.view.camera.fy = gradients.camera.fy;
  in.view.camera.cx = gradients.camera.cx;
  in.view.camera.cy = gradients.camera.cy;
  in.view.background = gradients.background;
  in.view.screen = gradients.screen;
  return in;
}

void set_number(Jet& number, double value, double slope) {
  number = Jet(value);
  number.v[0] = slope;
}
void set_number(Dual& number, double value, double slope) { number = {value, slope}; }

/// The inputs as Jets or Duals that move along `direction`, which has a number for each.
template <class T>
ExactInputs<T> along(const ExactInputs<double>& from, const std::vector<double>& direction) {
  ExactInputs<T> to;
  to.gaussians.sh_degree = from.gaussians.sh_degree;
  to.gaussians.channels = from.gaussians.channels;
  to.gaussians.means.resize(from.gaussians.means.size());
  to.gaussians.rotations.resize(from.gaussians.rotations.size());
  to.gaussians.log_scales.resize(from.gaussians.log_scales.size());
  to.gaussians.covariances.resize(from.gaussians.covariances.size());
  to.gaussians.opacities.resize(from.gaussians.opacities.size());
  to.gaussians.colors.resize(from.gaussians.colors.size());
  to.gaussians.sh.resize(from.gaussians.sh.size());
  to.gaussians.features.resize(from.gaussians.features.size());
  to.view.screen.resize(from.view.screen.size());
  to.view.camera.width = from.view.camera.width;
  to.view.camera.height = from.view.camera.height;
  std::vector<double> values;
  for_each_number(from, [&](const char*, double value) { values.push_back(value); });
  std::size_t k = 0;
  for_each_number(to, [&](const char*, T& number) {
    set_number(number, values[k], direction[k]);
    ++k;
  });
  return to;
}

template <class T>
T loss_of(const ExactPicture<T>& picture, const ExactPicture<double>& dL) {
  T loss(0);
  for (std::size_t i = 0; i < dL.image.size(); ++i)
    loss += inner(picture.image[i], Vec3<T>(dL.image[i]));
  for (std::size_t i = 0; i < dL.alpha.size(); ++i)
    loss += picture.alpha[i] * dL.alpha[i] + picture.depth[i] * dL.depth[i] +
            picture.inverse_depth[i] * dL.inverse_depth[i];
  for (std::size_t i = 0; i < dL.features.size(); ++i) loss += picture.features[i] * dL.features[i];
  return loss;
}

// For each kind of input: <gradient, v> is the slope along a random v, beside the size of its terms.
TEST(ExactRenderer, EveryInputHasTheSlopeOfJetsAndOfDualNumbers) {
  TestRandom random;
  for (const InputShape& shape : kShapes)
    for (const auto& [rule, is_smooth] :
         {std::pair{BlendRule::faster_gs, false}, std::pair{BlendRule::classic, false},
          std::pair{BlendRule::faster_gs, true}}) {
      ExactSettings settings;
      settings.rule = rule;
      settings.is_smooth = is_smooth;
      settings.splat.antialias = shape.antialias;
      settings.splat.antialias_detach = false;
      settings.splat.blur = shape.channels > 0 ? 0.5f : 0;
      const ExactInputs<double> in = draw_inputs(random, shape, 30, kExactWidth, kExactHeight);
      const ExactPicture<double> dL =
          draw_picture_gradient(random, shape.channels, kExactWidth, kExactHeight);
      const ExactInputs<double> gradient =
          as_inputs(exact_gradients(in.gaussians, in.view, settings, dL));
      for (const char* name : kNames) {
        SCOPED_TRACE(std::string(name) + " of " + std::to_string(shape.sh_degree));
        std::vector<double> direction;
        double expected = 0, terms = 0;
        bool has_numbers = false;
        for_each_number(gradient, [&](const char* of, double slope) {
          const bool moves = std::string_view(of) == name;
          has_numbers |= moves;
          direction.push_back(moves ? random.uniform(-1, 1) : 0);
          expected += slope * direction.back();
          terms += std::abs(slope * direction.back());
        });
        if (!has_numbers) continue;
        const ExactInputs<Jet> moving = along<Jet>(in, direction);
        const Jet loss = loss_of(exact_picture(moving.gaussians, moving.view, settings), dL);
        EXPECT_GT(terms, 0);
        EXPECT_NEAR(loss.v[0], expected, kSlopeTolerance * terms);
        const ExactInputs<Dual> dual = along<Dual>(in, direction);
        const Dual dual_loss = loss_of(exact_picture(dual.gaussians, dual.view, settings), dL);
        EXPECT_NEAR(dual_loss.slope, expected, kSlopeTolerance * terms);
      }
    }
}

TEST(ExactRenderer, TheProjectedMeanHasTheSlopeOfThePrincipalPoint) {
  TestRandom random;
  ExactInputs<double> in =
      draw_inputs(random, {-1, 0, false, false}, 20, kExactWidth, kExactHeight);
  // So wide that all are inside the limits of the Jacobian, and the principal point moves means alone.
  in.view.camera.fx = in.view.camera.fy = 6;
  ExactSettings settings;
  settings.is_smooth = true;
  ExactPicture<double> dL;
  for (int i = 0; i < kExactWidth * kExactHeight; ++i) dL.image.push_back(random.uniform3(-1, 1));
  const ExactGradients gradients = exact_gradients(in.gaussians, in.view, settings, dL);
  Vec2<double> sum{0, 0};
  for (const Vec2<double>& of_row : gradients.screen) sum += of_row;
  EXPECT_NEAR(sum.x, gradients.camera.cx, 1e-9);
  EXPECT_NEAR(sum.y, gradients.camera.cy, 1e-9);
}

// The same Gaussians as a model in float: the brute-force picture reads their stored numbers.
TEST(ExactRenderer, PictureIsTheBruteForceOne) {
  for (const BlendRule rule : {BlendRule::faster_gs, BlendRule::classic}) {
    const Camera camera = random_camera(40, 30, 1);
    const Gaussians model = random_gaussians(kTypical, 40, camera, 5);
    RenderSettings render;
    render.blend_rule = rule;
    render.background = {0.2f, 0.5f, 0.7f};
    const std::vector<DoubleGaussian> rows = in_double(model);
    const ReferencePicture expected =
        reference_picture(reference_splats<double>(rows, camera, render), render, 40, 30);

    ExactGaussians<double> gaussians;
    gaussians.sh_degree = kMaxShDegree;
    for (const DoubleGaussian& row : rows) {
      gaussians.means.push_back(row.mean);
      gaussians.rotations.push_back(row.rotation);
      gaussians.log_scales.push_back(row.log_scale);
      gaussians.opacities.push_back(sigmoid(row.logit_opacity));
      gaussians.sh.push_back(row.sh0);
      gaussians.sh.insert(gaussians.sh.end(), row.sh_rest, row.sh_rest + kShRestCount);
    }
    ExactSettings settings;
    settings.rule = rule;
    const ExactPicture<double> picture =
        exact_picture(gaussians, {camera_as<double>(camera), Vec3d(render.background)}, settings);
    double worst = 0;
    for (std::size_t i = 0; i < picture.image.size(); ++i) {
      for (int c = 0; c < 3; ++c)
        worst = std::max(worst, std::abs(picture.image[i][c] - expected.pixels[i].color[c]));
      worst = std::max(worst, std::abs(picture.alpha[i] - (1 - expected.pixels[i].transmittance)));
    }
    EXPECT_LT(worst, 1e-12);
  }
}

// The stages compute in float, and so may disagree about a tile that a splat only just touches.
TEST(ExactRenderer, FootprintsAreThoseOfTheStages) {
  Camera camera = random_camera(70, 50, 2);
  const Gaussians model = random_gaussians(kTypical, 200, camera, 6);
  camera.width = 20;  // so that many are beside the picture
  const RenderSettings render;
  RenderPass pass(host_memory());
  preprocess(model.span(), camera, render, pass);
  ExactGaussians<double> gaussians;
  for (const DoubleGaussian& row : in_double(model)) {
    gaussians.means.push_back(row.mean);
    gaussians.rotations.push_back(row.rotation);
    gaussians.log_scales.push_back(row.log_scale);
    gaussians.opacities.push_back(sigmoid(row.logit_opacity));
    gaussians.colors.push_back(row.sh0);
  }
  const ExactFootprints footprints =
      exact_footprints(gaussians, {camera_as<double>(camera)}, ExactSettings{});
  int visible = 0, different = 0;
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    const bool is_listed = pass.tile_counts[i] > 0;
    visible += is_listed;
    different += is_listed != (footprints.radii[i] > 0);
    if (!is_listed || footprints.radii[i] == 0) continue;
    const Splat& splat = pass.splats[i];
    EXPECT_NEAR(footprints.means2d[i].x, splat.mean2d.x, 1e-3);
    EXPECT_NEAR(footprints.depths[i], pass.splats[i].depth, 1e-5 * pass.splats[i].depth);
    EXPECT_NEAR(footprints.conics[i].yy, splat.conic.yy, 1e-3 * splat.conic.yy);
    // The axis is at least as long as the ellipse is high.
    EXPECT_GE(footprints.radii[i], std::sqrt(2 * splat.cutoff * splat.variance_y) * (1 - 1e-5));
  }
  EXPECT_GT(visible, 20);
  EXPECT_LT(visible, 200);
  EXPECT_LE(different, 1);
}

// Without clamps and ends, a finite step sees no jump.
TEST(ExactRenderer, ASmoothPictureHasTheSlopeOfFiniteDifferences) {
  TestRandom random;
  const ExactInputs<double> in =
      draw_inputs(random, {2, 2, false, false}, 8, kExactWidth, kExactHeight);
  ExactSettings settings;
  settings.is_smooth = true;
  const ExactPicture<double> dL = draw_picture_gradient(random, 2, kExactWidth, kExactHeight);
  const ExactGradients gradients = exact_gradients(in.gaussians, in.view, settings, dL);
  constexpr double kStep = 1e-5;
  for (std::size_t i = 0; i < in.gaussians.count(); ++i) {
    const auto loss_at = [&](double step) {
      ExactInputs<double> moved = in;
      moved.gaussians.means[i].x += step;
      moved.gaussians.opacities[i] -= 0.1 * step;
      return loss_of(exact_picture(moved.gaussians, moved.view, settings), dL);
    };
    const double slope = (loss_at(kStep) - loss_at(-kStep)) / (2 * kStep);
    EXPECT_NEAR(slope, gradients.means[i].x - 0.1 * gradients.opacities[i],
                1e-6 * (1 + std::abs(slope)));
  }
}

TEST(ExactRenderer, NothingVisibleShowsTheBackground) {
  ExactView<double> view;
  view.camera = {3, 2, 5.0, 5.0, 1.5, 1.0};
  view.background = {0.1, 0.2, 0.3};
  const ExactPicture<double> picture = exact_picture(ExactGaussians<double>{}, view, {});
  for (const Vec3d& pixel : picture.image) EXPECT_EQ(pixel, view.background);
  ExactPicture<double> dL;
  dL.image.assign(6, Vec3d(1.0));
  EXPECT_EQ(exact_gradients({}, view, {}, dL).background, Vec3d(6.0));
}

TEST(ExactRenderer, ArraysThatDisagreeAreRefused) {
  TestRandom random;
  ExactInputs<double> in = draw_inputs(random, {-1, 2, false, false}, 4, kExactWidth, kExactHeight);
  const ExactPicture<double> whole = exact_picture(in.gaussians, in.view, {});
  ExactPicture<double> dL;
  dL.alpha.assign(7, 1);
  EXPECT_THROW(exact_gradients(in.gaussians, in.view, {}, dL), UsageError);
  in.gaussians.opacities.pop_back();
  EXPECT_THROW(exact_picture(in.gaussians, in.view, {}), UsageError);
}

}  // namespace
}  // namespace gs
