// SPDX-License-Identifier: Apache-2.0
// Surfaces on the GPU, their pictures and their steps, against the scalar backend.
#include "gs_core/math/render/surface_loss.h"
#include "tests/support/cuda.h"

namespace gs {
namespace {

constexpr int kWidth = 131, kHeight = 77;
// Relative, of gradients: one of the two backends may keep a fragment, a pixel or a patch at a
// threshold, and the other leave it out.
constexpr float kTolerance = 2e-2;

/// Three views of one smooth photo from beside each other; the second one has a mask, and the third
/// one no normal map.
Scene views_of_a_wall() {
  Scene scene;
  for (int i = 0; i < 3; ++i) {
    View view;
    view.name = "view " + std::to_string(i);
    view.camera = random_camera(kWidth, kHeight, 1);
    view.camera.cam_from_world_translation.x += 0.05f * float(i);
    view.photo = Image8(kWidth, kHeight, 3);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        for (int c = 0; c < 3; ++c)
          view.photo.at(x, y, c) = std::uint8_t(127 + 60 * std::sin(0.3 * x + 0.2 * y + c) +
                                                60 * std::cos(0.25 * y - 0.1 * x));
    if (i == 1) {
      view.mask = Image8(kWidth, kHeight, 1, 255);
      for (int y = 0; y < kHeight; ++y)
        for (int x = 40; x < 60; ++x) view.mask.at(x, y, 0) = 0;
    }
    if (i != 2) {
      view.has_normal_map = true;
      view.normals = Image8(kWidth, kHeight, 3);
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
          if ((x / 7 + y / 5) % 6 == 0) continue;  // nothing is known there
          const Vec3f n{0.5f * std::sin(0.2f * float(x)), 0.3f * std::cos(0.1f * float(y)), -0.8f};
          const NormalBytes bytes = bytes_of_normal(n / std::sqrt(inner(n, n)));
          std::uint8_t* const to = &view.normals.at(x, y, 0);
          to[0] = bytes.x, to[1] = bytes.y, to[2] = bytes.z;
        }
    }
    scene.train_views.push_back(std::move(view));
  }
  scene.extent = 0.5f;
  return scene;
}

/// Gaussians at about one depth, which cover most of the picture.
Gaussians wall(const Camera& camera, std::size_t count = 3000) {
  Gaussians gaussians = random_gaussians(kTypical, count, camera, 5);
  Draws draws(8);
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3f p = to_camera(camera, gaussians.mean[i]);
    const Vec3f at = p * (draws.uniform(2.9f, 3.1f) / p.z);
    gaussians.mean[i] =
        multiply_transposed(camera.cam_from_world_rotation, at - camera.cam_from_world_translation);
    gaussians.logit_opacity[i] += 2;
  }
  return gaussians;
}

class CudaSurface : public CudaTest {
 protected:
  void SetUp() override {
    CudaTest::SetUp();
    if (!IsSkipped()) gpu().device().upload_views(scene_.train_views, 0);
  }
  Gaussians plain() const { return wall(scene_.train_views[0].camera); }

  void step(Backend& backend, TrainingModel& model, const std::vector<std::size_t>& rows,
            const RenderSettings& settings, const SurfaceWeights& weights,
            const DensityStep& density = {true}) const {
    std::vector<TrainingPhoto> batch;
    for (const std::size_t row : rows) {
      TrainingPhoto photo{&scene_.train_views[row], settings, rows.size() > 1 ? 2 : 1, row};
      photo.neighbor = &scene_.train_views[(row + 1) % 3];
      photo.patch_phase = int(5 * row);
      batch.push_back(photo);
    }
    LossSettings loss{0.2f};
    loss.surface = weights;
    backend.step(model, {{batch.data(), batch.size()},
                         loss,
                         Update{kRates, batch_rule(int(rows.size()))},
                         density});
  }
  void expect_scalar_step(const Gaussians& gaussians, const SurfaceWeights& weights,
                          const RenderSettings& settings = {},
                          const DensityStep& density = {true}) {
    for (const std::vector<std::size_t>& rows :
         {std::vector<std::size_t>{0}, std::vector<std::size_t>{1},
          std::vector<std::size_t>{0, 1, 2, 0}}) {
      SCOPED_TRACE(rows.size());
      TrainingModel expected = model_of(gaussians), actual = on_gpu(expected);
      step(cpu(), expected, rows, settings, weights, density);
      step(gpu(), actual, rows, settings, weights, density);
      gpu().synchronize(actual);
      const TrainingModel here = on_host(actual);
      // A patch near a threshold may count on one side alone, and the loss of photos has few.
      const float tolerance = weights.photo > 0 && !(weights.normal > 0) ? 0.1f : kTolerance;
      // The first moments are the gradients times a constant, after one step.
      for_each_array(
          [&](const char* name, const auto& a, const auto& b) {
            EXPECT_LT(norm_difference(downloaded(a), downloaded(b)), tolerance) << name;
          },
          opened(here).first, opened(expected).first);
      EXPECT_LT(norm_difference(downloaded(here.statistics.gradient_norm),
                                downloaded(expected.statistics.gradient_norm)),
                tolerance);
    }
  }

  const Scene scene_ = views_of_a_wall();
};

TEST_F(CudaSurface, PicturesAndTheirGradientsAreTheScalarOnes) {
  const Camera& camera = scene_.train_views[0].camera;
  for (const bool is_filtered : {false, true}) {
    const Gaussians gaussians = is_filtered ? with_filters(plain(), 44) : plain();
    const Gaussians there = on_gpu(gaussians);
    RenderSettings settings;
    settings.blends_surface = true;
    settings.antialias = is_filtered;
    RenderPass expected, actual(gpu().memory());
    cpu().renderer().forward(gaussians.span(), camera, settings, expected);
    gpu().renderer().forward(there.span(), camera, settings, actual);
    EXPECT_LT(norm_difference(downloaded(actual.surface_image), downloaded(expected.surface_image)),
              1e-3);

    Draws draws(6);
    std::vector<SurfaceRow> by_surface(expected.pixel_count());
    for (SurfaceRow& row : by_surface) {
      const auto number = [&] { return draws.uniform(-1, 1); };
      row = {{number(), {number(), number()}, {number(), number(), number()}}, number()};
    }
    const auto gradient = [&](Backend& backend, const Gaussians& of, RenderPass& pass) {
      Buffer<float> dL_dimage(3 * pass.pixel_count(), backend.memory());
      dL_dimage.fill_zero();
      Buffer<SurfaceRow> dL_dsurface(backend.memory());
      dL_dsurface.upload(by_surface);
      PictureGradient dL{dL_dimage.span()};
      dL.surface = dL_dsurface.span();
      Gaussians gradients(of.count(), backend.memory());
      Buffer<Vec2f> dL_dmean2d(of.count(), backend.memory());
      backend.renderer().backward(of.span(), camera, settings, pass, dL, gradients.span(),
                                  dL_dmean2d.span());
      return gradients;
    };
    const Gaussians a = gradient(gpu(), there, actual), b = gradient(cpu(), gaussians, expected);
    for_each_array(
        [&](const char* name, const auto& x, const auto& y) {
          EXPECT_LT(norm_difference(downloaded(x), downloaded(y)), 1e-2) << name << is_filtered;
        },
        a, b);
  }
}

TEST_F(CudaSurface, AStepIsTheScalarOneForEachTerm) {
  for (const SurfaceWeights& weights : {SurfaceWeights{2, 0}, SurfaceWeights{0, 2},
                                        SurfaceWeights{0, 0, 2}, SurfaceWeights{1, 1, 1}}) {
    SCOPED_TRACE(testing::Message() << weights.normal << weights.photo << weights.prior);
    expect_scalar_step(plain(), weights);
  }
}

TEST_F(CudaSurface, AStepIsTheScalarOneWithOtherSettings) {
  RenderSettings settings;
  settings.antialias = true;
  settings.background = {0.2f, 0.5f, 0.8f};
  expect_scalar_step(with_filters(plain(), 44), {1, 1}, settings);
  settings = {};
  settings.blend_rule = BlendRule::classic;
  settings.use_tensor_cores = false;
  expect_scalar_step(plain(), {1, 1}, settings);
  settings = {};
  settings.absolute_gradient = true;
  expect_scalar_step(plain(), {1, 1}, settings);
}

// The sums of forces are those of the colors, although surfaces add to the same gradients.
TEST_F(CudaSurface, ForcesAreThoseOfTheScalarStep) {
  const DensityStep density{.gather_statistics = true, .score = GrowthScore::force};
  TrainingModel expected = model_of(plain()), actual = on_gpu(expected);
  step(cpu(), expected, {0}, {}, {1, 1}, density);
  step(gpu(), actual, {0}, {}, {1, 1}, density);
  gpu().synchronize(actual);
  EXPECT_LT(norm_difference(downloaded(on_host(actual).statistics.sums),
                            downloaded(expected.statistics.sums)),
            1e-2);
}

// The terms leave nothing behind for steps without them.
TEST_F(CudaSurface, IsNoPartOfOtherSteps) {
  RenderSettings settings;
  settings.deterministic = true;
  const TrainingModel start = model_of(plain());
  TrainingModel never = on_gpu(start), later = on_gpu(start), other = on_gpu(start);
  step(gpu(), never, {0}, settings, {});
  step(gpu(), other, {0}, settings, {1, 1});
  step(gpu(), later, {0}, settings, {});
  gpu().synchronize(later);
  EXPECT_TRUE(same_bits(on_host(later), on_host(never)));
  EXPECT_FALSE(same_bits(on_host(other), on_host(never)));
}

}  // namespace
}  // namespace gs
