// SPDX-License-Identifier: Apache-2.0
// The gradient of surface terms through the whole pipeline, in float and by tiles, equals the slope
// of a brute-force sum over fragments in double, together with the gradient of a picture.
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/surface_loss.h"
#include "gs_render/renderer.h"
#include "gs_train/stages/scalar_stages.h"
#include "tests/stages/slopes.h"

namespace gs {
namespace {

/// Gaussians, a view with a mask, and weights of all numbers of a picture of surfaces.
struct SurfaceScene {
  Camera camera = slope_camera();
  RenderSettings settings;
  Gaussians gaussians = random_gaussians(kTypical, 9, camera, 21);
  std::vector<float> weights = loss_weights(9);  // of the linear loss of colors
  std::vector<SurfaceRow> by_surface;

  SurfaceScene() {
    Draws draws(10);
    const auto number = [&] { return draws.uniform(-1, 1); };
    for (std::size_t i = 0; i < kPixels; ++i)
      by_surface.push_back(
          {{number(), {0.05f * number(), 0.05f * number()}, {number(), number(), number()}},
           number()});
  }
};

struct SurfacePipeline {
  RenderPass pass;
  Gaussians gradients;
  Buffer<Vec2f> dL_dmean2d;

  explicit SurfacePipeline(const SurfaceScene& scene) {
    const auto renderer = make_scalar_renderer();
    RenderSettings settings = scene.settings;
    settings.blends_surface = true;
    renderer->forward(scene.gaussians.span(), scene.camera, settings, pass);
    const Buffer<float> dL_dimage = uploaded(scene.weights);
    gradients.resize(scene.gaussians.count());
    dL_dmean2d.resize(scene.gaussians.count());
    PictureGradient dL{dL_dimage.span()};
    dL.surface = {scene.by_surface.data(), scene.by_surface.size()};
    renderer->backward(scene.gaussians.span(), scene.camera, settings, pass, dL, gradients.span(),
                       dL_dmean2d.span());
  }
};

/// The numbers of a row, in threes; those after the coverage are 0.
std::array<Vec3d, 3> threes(const SplatSurface<double>& of, double coverage) {
  return {Vec3d(of.at_axis, of.slope.x, of.slope.y), of.normal, Vec3d(coverage, 0.0, 0.0)};
}

/// The picture's loss and that of its surfaces, in double.
double surface_reference_loss(const std::vector<DoubleGaussian>& gaussians,
                              const SurfaceScene& scene, const PinholeCamera<double>& camera,
                              std::uint64_t& decisions) {
  constexpr double kRaised = 1000;  // colors below 0 count as 0
  ReferenceSplats splats = reference_splats<double>(gaussians, camera, scene.settings);
  const ReferencePicture picture = reference_picture(splats, scene.settings, kWidth, kHeight);
  decisions = picture.decisions();
  double loss = linear_loss(scene.weights, picture.planes());
  RenderSettings of_surface = scene.settings;
  of_surface.background = Vec3f(0);
  std::vector<double> coverage;
  for (int part = 2; part >= 0; --part) {
    for (auto& entry : splats.entries) {
      const DoubleGaussian& g = gaussians[entry.gaussian];
      const SplatSurface<double> surface =
          splat_surface(camera, {g.mean, g.log_scale, g.rotation}, g.filter_scale, of_surface);
      entry.splat.color = threes(surface, 1)[std::size_t(part)] + Vec3d(part == 2 ? 0 : kRaised);
    }
    const std::vector<double> planes =
        reference_picture(splats, of_surface, kWidth, kHeight).planes();
    if (part == 2) coverage.assign(planes.begin(), planes.begin() + kPixels);
    for (std::size_t i = 0; i < kPixels; ++i) {
      const SurfaceRow& by = scene.by_surface[i];
      const SplatSurface<double> weights{double(by.of.at_axis), Vec2<double>(by.of.slope),
                                         Vec3d(by.of.normal)};
      const Vec3d of_part = threes(weights, double(by.coverage))[std::size_t(part)];
      for (int c = 0; c < 3; ++c)
        loss += of_part[c] *
                (planes[std::size_t(c) * kPixels + i] - (part == 2 ? 0 : kRaised * coverage[i]));
    }
  }
  return loss;
}

void expect_slopes(const SurfaceScene& scene, const char* what) {
  SCOPED_TRACE(what);
  const SurfacePipeline pipeline(scene);
  const auto camera = camera_as<double>(scene.camera);
  expect_slopes(scene.gaussians, pipeline.gradients, {2e-6, 1e-4, 0.05, false},
                [&](const std::vector<DoubleGaussian>& gaussians, std::uint64_t& decisions) {
                  return surface_reference_loss(gaussians, scene, camera, decisions);
                });
}

TEST(SurfaceGradient, IsTheSlopeInEveryScene) {
  for (const SceneChange& change : kSceneChanges) {
    SurfaceScene scene;
    change.apply(scene.camera, scene.settings, scene.gaussians);
    if (!scene.gaussians.has_time && !scene.camera.has_lens()) expect_slopes(scene, change.name);
  }
}

TEST(SurfaceGradient, LeavesTheColorsAsTheyAre) {
  SurfaceScene scene;
  RenderPass plain, with_surface;
  for (RenderPass* pass : {&plain, &with_surface}) {
    make_scalar_renderer()->forward(scene.gaussians.span(), scene.camera, scene.settings, *pass);
    scene.settings.blends_surface = true;
  }
  EXPECT_TRUE(plain.surface_image.empty());
  EXPECT_TRUE(same_bits(plain.image, with_surface.image));
  EXPECT_TRUE(same_bits(plain.transmittance, with_surface.transmittance));
}

TEST(SurfaceGradient, HasTheSameBitsWithAnyNumberOfThreads) {
  SurfaceScene scene;
  scene.gaussians = random_gaussians(kTypical, 3000, scene.camera, 5);
  const auto gradients = [&] { return copy_of(SurfacePipeline(scene).gradients); };
  EXPECT_TRUE(same_bits(with_threads(1, gradients), with_threads(7, gradients)));
}

/// A picture of surfaces: a tilted plane with bumps, whose normals are those of a smoother one.
struct BumpyPicture {
  View view, neighbor;
  RenderPass pass;

  BumpyPicture() {
    Draws draws(3);
    view.camera = random_camera(kWidth, kHeight, 3);
    view.photo = random_photo(kWidth, kHeight, 1);
    view.mask = Image8(kWidth, kHeight, 1, 255);
    for (int k = 0; k < 5; ++k) view.mask.pixels[std::size_t(draws.uniform(0, kPixels - 1))] = 0;
    view.normals = Image8(kWidth, kHeight, 3);
    Draws of_prior(4);
    for (std::size_t i = 0; i < kPixels; ++i) {
      const Vec3f n = of_prior.uniform3(-1, 1);
      const NormalBytes bytes = i % 5 ? bytes_of_normal(n / length(n)) : NormalBytes{};
      std::uint8_t* const to = &view.normals.pixels[3 * i];
      to[0] = bytes.x, to[1] = bytes.y, to[2] = bytes.z;
    }
    neighbor = view;
    neighbor.mask = {};
    neighbor.camera.cam_from_world_translation.x += 0.02f;
    pass.surface_image.resize(kPixels);
    for (std::size_t i = 0; i < kPixels; ++i) {
      const float a = draws.uniform(0.7f, 1);
      pass.surface_image[i] = {{a * draws.uniform(0.498f, 0.502f),
                                {a * 2e-4f, a * -3e-4f},
                                Vec3f(draws.uniform(-0.2f, 0.2f), 0.1f, -0.8f) * a},
                               a};
    }
    pass.surface_image[100].coverage = 0.2f;
  }
  double compare(const SurfaceWeights& weights, SurfaceGradient& dL) const {
    return compare_surface(view, &neighbor, weights, 5, pass, dL);
  }
};

// Each number of a pixel also moves the normals of the four around it.
TEST(SurfaceGradient, OfTheLossesIsTheirSlope) {
  for (const SurfaceWeights weights :
       {SurfaceWeights{100, 0}, SurfaceWeights{0, 100}, SurfaceWeights{0, 0, 100}}) {
    BumpyPicture picture;
    SurfaceGradient dL, unused;
    const double loss = picture.compare(weights, dL);
    EXPECT_GT(loss, 0);
    double worst = 0, largest = 0;
    int compared = 0;
    for (std::size_t i = 0; i < kPixels; i += 7) {
      const auto check = [&](float& number, float by, float step) {
        const float value = number;
        number = value + step;
        const double high = picture.compare(weights, unused);
        number = value - step;
        const double low = picture.compare(weights, unused);
        number = value;
        const double slope = (high - low) / (2 * double(step));
        // A gray value at the edge of a pixel has two slopes, and floats have few digits.
        largest = std::max(largest, std::abs(slope));
        worst = std::max(worst, std::abs(slope - double(by)));
        ++compared;
      };
      SurfaceRow& row = picture.pass.surface_image[i];
      const SurfaceRow by = dL.sums[i];
      check(row.of.at_axis, by.of.at_axis, 2e-4f);
      check(row.of.normal.x, by.of.normal.x, 2e-3f);
      check(row.coverage, by.coverage, 2e-4f);
    }
    EXPECT_GT(compared, 300);
    EXPECT_LT(worst, 0.02 * largest) << weights.normal;
  }
}

}  // namespace
}  // namespace gs
