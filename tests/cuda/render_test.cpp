// SPDX-License-Identifier: Apache-2.0
// Stages 1 to 4, 6 and 7: the CUDA renderer compared with the scalar one, field by field of the
// RenderPass.
#include "gs_train/density/contribution.h"
#include "tests/support/cuda.h"
#include "tests/support/lens_scenes.h"

namespace gs {
namespace {

// exp, log and the order of sums differ in the last bits between the two backends, so a fragment or
// a tile very close to its threshold may be kept by one and dropped by the other. This fraction of
// all may differ:
constexpr double kBorderline = 2e-3;

struct Scene {
  std::string name;
  Gaussians gaussians;
  Camera camera;
  RenderSettings settings;
};

GaussianModel model_of_file(const Gaussians& gaussians) {
  return {copy_of(gaussians), kMaxShDegree, true, false};
}

struct Rendered {
  RenderPass cpu, gpu;
  Gaussians on_gpu;
  explicit Rendered(Memory& memory) : gpu(memory), on_gpu(memory) {}
};

class CudaRender : public CudaTest {
 protected:
  Rendered render(const Gaussians& gaussians, const Camera& camera,
                  const RenderSettings& settings) {
    Rendered result(gpu().memory());
    result.on_gpu = copy_to(gpu().memory(), model_of_file(gaussians));
    cpu().renderer().forward(gaussians.span(), camera, settings, result.cpu);
    gpu().renderer().forward(result.on_gpu.span(), camera, settings, result.gpu);
    return result;
  }

  std::vector<Scene> scenes() {
    std::vector<Scene> all;
    const auto add = [&](std::string name, const Recipe& recipe, int width, int height,
                         RenderSettings settings = {}) {
      const Camera camera = random_camera(width, height, all.size() + 1);
      all.push_back({std::move(name), random_gaussians(recipe, 2000, camera, all.size() + 10),
                     camera, settings});
    };
    RenderSettings classic, antialias, white;
    classic.blend_rule = BlendRule::classic;
    antialias.antialias = true;
    white.background = {1, 0.5f, 0.25f};
    add("typical", kTypical, 160, 120);
    add("typical, white", kTypical, 160, 120, white);
    add("odd size", kTypical, 131, 77);
    add("classic", kTypical, 160, 120, classic);
    add("classic, opaque", kOpaque, 160, 120, classic);
    add("opaque", kOpaque, 160, 120, white);
    add("antialias", kTypical, 160, 120, antialias);
    add("sharp", kSharp, 160, 120);
    add("huge", kHuge, 200, 150);
    add("faint", kFaint, 160, 120);
    add("negative colors", kNegativeColors, 160, 120, white);
    for (const Truncation truncation :
         {Truncation::sigma2, Truncation::sigma3, Truncation::sigma4}) {
      RenderSettings settings;
      settings.truncation = truncation;
      add("truncation " + std::to_string(int(truncation)), kTypical, 160, 120, settings);
    }
    for (const TileBounds bounds : {TileBounds::box, TileBounds::square}) {
      RenderSettings settings;
      settings.bounds = bounds;
      add("bounds " + std::to_string(int(bounds)), kTypical, 160, 120, settings);
    }
    for (int degree : {0, 1, 2, 3}) {
      RenderSettings settings;
      settings.sh_degree = degree;
      add("in space and time, degree " + std::to_string(degree), kTypical, 131, 77, settings);
      all.back().gaussians = in_spacetime(all.back().gaussians, 7);
      all.back().camera.time = 0.5f;
      settings.antialias = degree % 2 == 1;
      settings.antialias_detach = false;
      add("3D filter, degree " + std::to_string(degree), kTypical, 131, 77, settings);
      all.back().gaussians = with_filters(all.back().gaussians, 9);
    }
    for (const LensScene& lens : lens_scenes()) {
      add(lens.name, kTypical, 160, 120);
      Scene& scene = all.back();
      scene.camera = with_lens(scene.camera, lens.model, lens.params, lens.motion);
      scene.gaussians =
          at_angles(std::move(scene.gaussians), scene.camera, lens.least, lens.most, all.size());
    }
    add("through a lens, in space and time", kTypical, 131, 77);
    all.back().camera = with_lens(all.back().camera, CameraModel::simple_fisheye, {0.7, 0.5, 0.4});
    all.back().gaussians = in_spacetime(all.back().gaussians, 7);
    all.back().camera.time = 0.5f;
    add("3D filter, sharp", kSharp, 160, 120);
    all.back().gaussians = with_filters(all.back().gaussians, 9);
    white.use_tensor_cores = classic.use_tensor_cores = false;
    add("simt", kTypical, 131, 77, white);
    add("simt, classic", kOpaque, 160, 120, classic);
    for (int degree = 0; degree < 3; ++degree) {
      RenderSettings settings;
      settings.sh_degree = degree;
      add("degree " + std::to_string(degree), kTypical, 90, 60, settings);
    }
    return all;
  }
};

/// The Gaussians of each tile, front to back.
std::vector<std::vector<std::uint32_t>> tile_lists(const RenderPass& pass) {
  const std::vector<std::uint32_t> ranges = pass.tile_ranges.download();
  std::vector<std::uint32_t> splats = pass.tile_splats.download();
  for (std::uint32_t& splat : splats) splat = gaussian_of(splat);
  std::vector<std::vector<std::uint32_t>> lists(pass.tile_count());
  for (std::size_t tile = 0; tile < lists.size(); ++tile)
    lists[tile].assign(splats.begin() + ranges[tile], splats.begin() + ranges[tile + 1]);
  return lists;
}

TEST_F(CudaRender, SplatsAgree) {
  for (const Scene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    const Rendered r = render(scene.gaussians, scene.camera, scene.settings);
    const auto cpu_counts = r.cpu.tile_counts.download(), gpu_counts = r.gpu.tile_counts.download();
    const auto cpu_splats = r.cpu.splats.download(), gpu_splats = r.gpu.splats.download();
    ASSERT_EQ(cpu_counts.size(), gpu_counts.size());
    std::size_t differ = 0, visible = 0;
    for (std::size_t i = 0; i < cpu_counts.size(); ++i) {
      differ += cpu_counts[i] != gpu_counts[i];
      if (!cpu_counts[i] || !gpu_counts[i]) continue;
      ++visible;
      const Splat &a = gpu_splats[i], &b = cpu_splats[i];
      // The mean at a moment depends on scales, whose exponential differs in the last digit, and
      // that through a fisheye on an arctangent.
      const bool differs = scene.gaussians.has_time || scene.camera.has_lens();
      const float rounding = differs ? 1e-3f : 0.0f;  // pixels
      EXPECT_NEAR(a.depth, b.depth, 1e-3f * rounding * b.depth);
      EXPECT_NEAR(a.mean2d.x, b.mean2d.x, rounding);
      EXPECT_NEAR(a.mean2d.y, b.mean2d.y, rounding);
      const float largest = std::max(std::abs(b.conic.xx), std::abs(b.conic.yy));
      // The determinant of a needle cancels, and so does the covariance at a moment.
      const float cancelled = (differs ? 1e-3f : 2e-4f) * largest;
      EXPECT_NEAR(a.conic.xx, b.conic.xx, cancelled);
      EXPECT_NEAR(a.conic.xy, b.conic.xy, cancelled);
      EXPECT_NEAR(a.conic.yy, b.conic.yy, cancelled);
      EXPECT_NEAR(a.opacity, b.opacity, scene.settings.antialias ? 1e-3f : 1e-6f);
      EXPECT_NEAR(a.color.x, b.color.x, 1e-5f);
      EXPECT_NEAR(a.color.y, b.color.y, 1e-5f);
      EXPECT_NEAR(a.color.z, b.color.z, 1e-5f);
    }
    EXPECT_LE(double(differ), kBorderline * double(cpu_counts.size()) + 1);
    EXPECT_GT(visible, scene.gaussians.count() / 20);
  }
}

// Both passes have the same lists, in the same order, except for borderline instances that only one
// of them has.
void expect_same_lists(const Rendered& r) {
  const auto cpu_lists = tile_lists(r.cpu), gpu_lists = tile_lists(r.gpu);
  ASSERT_EQ(cpu_lists.size(), gpu_lists.size());
  std::size_t differ = 0, instances = 0;
  for (std::size_t tile = 0; tile < cpu_lists.size(); ++tile) {
    const auto &a = cpu_lists[tile], &b = gpu_lists[tile];
    instances += a.size();
    if (a == b) continue;
    std::vector<std::uint32_t> both_a, both_b;
    for (const std::uint32_t g : a)
      if (std::find(b.begin(), b.end(), g) != b.end()) both_a.push_back(g);
    for (const std::uint32_t g : b)
      if (std::find(a.begin(), a.end(), g) != a.end()) both_b.push_back(g);
    EXPECT_EQ(both_a, both_b);
    differ += a.size() + b.size() - 2 * both_a.size();
  }
  EXPECT_LE(double(differ), kBorderline * double(instances) + 1);
  EXPECT_GT(instances, 0u);
}

TEST_F(CudaRender, TileListsAgree) {
  for (const Scene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    expect_same_lists(render(scene.gaussians, scene.camera, scene.settings));
  }
}

// More bins of 128 pixels than one block counts, and more in a row than eight bits can number.
TEST_F(CudaRender, TileListsOfLargePicturesAgree) {
  for (const auto& [width, height] : {std::pair{6000, 3000}, {34000, 40}, {40, 34000}}) {
    SCOPED_TRACE(std::to_string(width) + "x" + std::to_string(height));
    const Camera camera = random_camera(width, height, 3);
    expect_same_lists(render(random_gaussians(kTypical, 3000, camera, 5), camera, {}));
  }
}

// Only the left half of the picture counts.
TEST_F(CudaRender, MaskedTilesHaveNoList) {
  for (const Scene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    const int width = scene.camera.width, height = scene.camera.height;
    Image8 mask(width, height, 1, 0);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width / 2; ++x) mask.at(x, y, 0) = 255;
    Buffer<std::uint8_t> on_gpu(gpu().memory());
    on_gpu.resize_discard(mask.pixels.size());
    gpu().memory().upload(on_gpu.data(), mask.pixels.data(), mask.pixels.size());
    Rendered r = render(scene.gaussians, scene.camera, scene.settings);
    const std::vector<float> whole = r.gpu.image.download();
    RenderSettings settings = scene.settings;
    settings.mask = mask.pixels.data();
    cpu().renderer().forward(scene.gaussians.span(), scene.camera, settings, r.cpu);
    settings.mask = on_gpu.data();
    gpu().renderer().forward(r.on_gpu.span(), scene.camera, settings, r.gpu);
    expect_same_lists(r);
    const auto lists = tile_lists(r.gpu);
    for (std::size_t tile = 0; tile < lists.size(); ++tile)
      if (int(tile % r.gpu.tiles_x) * kTileWidth >= width / 2) {
        EXPECT_TRUE(lists[tile].empty());
      }
    const std::vector<float> masked = r.gpu.image.download();
    for (std::size_t i = 0; i < whole.size(); ++i)
      if (int(i % std::size_t(width)) < width / 2) {
        ASSERT_EQ(masked[i], whole[i]) << i;
      }
  }
}

TEST_F(CudaRender, PicturesAgree) {
  for (const Scene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    const Rendered r = render(scene.gaussians, scene.camera, scene.settings);
    const auto cpu_image = r.cpu.image.download(), gpu_image = r.gpu.image.download();
    const auto cpu_T = r.cpu.transmittance.download(), gpu_T = r.gpu.transmittance.download();
    const auto cpu_last = r.cpu.last_instance.download(), gpu_last = r.gpu.last_instance.download();
    ASSERT_EQ(cpu_image.size(), gpu_image.size());
    std::size_t image_differs = 0, T_differs = 0, last_differs = 0;
    for (std::size_t i = 0; i < cpu_image.size(); ++i) {
      ASSERT_TRUE(std::isfinite(gpu_image[i]));
      image_differs += std::abs(cpu_image[i] - gpu_image[i]) > 1e-4f;
    }
    for (std::size_t i = 0; i < cpu_T.size(); ++i) {
      T_differs += !(std::abs(cpu_T[i] - gpu_T[i]) <= 1e-4f);
      last_differs += cpu_last[i] != gpu_last[i];
    }
    EXPECT_LE(double(image_differs), kBorderline * double(cpu_image.size()) + 1);
    EXPECT_LE(double(T_differs), kBorderline * double(cpu_T.size()) + 1);
    EXPECT_LE(double(last_differs), 5 * kBorderline * double(cpu_T.size()) + 1);
  }
}

TEST_F(CudaRender, GradientsAgree) {
  for (const Scene& scene : scenes()) {
    for (const float scale : {1.0f, 1e-8f}) {  // of a gradient for tests, and of a photo's
      SCOPED_TRACE(testing::Message() << scene.name << ", " << scale);
      Rendered r = render(scene.gaussians, scene.camera, scene.settings);
      std::vector<float> dL_dimage(r.cpu.image.size());
      Draws draws(99);
      for (float& value : dL_dimage) value = scale * draws.normal();
      Buffer<float> cpu_dL, gpu_dL(gpu().memory());
      cpu_dL.upload(dL_dimage);
      gpu_dL.upload(dL_dimage);
      const std::size_t count = scene.gaussians.count();
      Gaussians cpu_gradients, gpu_gradients(gpu().memory());
      for (Gaussians* const gradients : {&cpu_gradients, &gpu_gradients}) {
        gradients->has_time = scene.gaussians.has_time;
        gradients->resize(count);
      }
      Buffer<Vec2f> cpu_mean2d(count, host_memory()), gpu_mean2d(count, gpu().memory());
      cpu().renderer().backward(scene.gaussians.span(), scene.camera, scene.settings, r.cpu,
                                cpu_dL.span(), cpu_gradients.span(), cpu_mean2d.span());
      // Each runs twice, because a call must not leave anything behind.
      for (const bool deterministic : {false, false, true, true}) {
        SCOPED_TRACE(deterministic);
        RenderSettings settings = scene.settings;
        settings.deterministic = deterministic;
        gpu().renderer().backward(r.on_gpu.span(), scene.camera, settings, r.gpu, gpu_dL.span(),
                                  gpu_gradients.span(), gpu_mean2d.span());
        EXPECT_LT(norm_difference(downloaded(gpu_mean2d), downloaded(cpu_mean2d)), 2e-3);
        for_each_array(
            [&](const char* name, const auto& a, const auto& b) {
              EXPECT_LT(norm_difference(downloaded(a), downloaded(b)), 2e-3) << name;
            },
            gpu_gradients, cpu_gradients);
      }
    }
  }
}

// Needles of 1 : 1000 lose digits in float in either renderer, but the pictures must look the same.
// A fragment at 1/255 that one keeps and the other drops counts as 0.004 pixels.
TEST_F(CudaRender, SharesOfGaussiansInAViewAgree) {
  const Camera camera = random_camera(131, 77);
  const Gaussians gaussians = random_gaussians(kTypical, 500, camera, 5);
  const Gaussians on_gpu = copy_to(gpu().memory(), model_of_file(gaussians));
  ContributionMeter expected(cpu().renderer(), gaussians.span(), {});
  ContributionMeter actual(gpu().renderer(), on_gpu.span(), {});
  const std::vector<float> wanted = expected.measure(camera), shares = actual.measure(camera);
  for (std::size_t i = 0; i < wanted.size(); ++i)
    EXPECT_NEAR(shares[i], wanted[i], 0.02f + 1e-3f * wanted[i]) << i;
}

TEST_F(CudaRender, NeedlesAgreeRoughly) {
  const Camera camera = random_camera(160, 120, 5);
  const Rendered r = render(random_gaussians(kNeedles, 2000, camera, 6), camera, {});
  EXPECT_LT(norm_difference(r.gpu.image.download(), r.cpu.image.download()), 0.02);
}

// ---- Edge cases

class CudaEdge : public CudaRender {
 protected:
  void expect_same_picture(const Gaussians& gaussians, const Camera& camera,
                           RenderSettings settings = {}) {
    settings.background = {0.25f, 0.5f, 0.75f};
    Rendered r = render(gaussians, camera, settings);
    const auto a = r.gpu.image.download(), b = r.cpu.image.download();
    ASSERT_EQ(a.size(), b.size());
    std::size_t differ = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
      ASSERT_TRUE(std::isfinite(a[i]));
      differ += std::abs(a[i] - b[i]) > 1e-4f;
    }
    EXPECT_LE(double(differ), kBorderline * double(a.size()) + 1);
    // The backward pass may not write where it should not.
    Buffer<float> dL(r.gpu.image.size(), gpu().memory());
    dL.upload(std::vector<float>(r.gpu.image.size(), 1.0f));
    Gaussians gradients(gaussians.count(), gpu().memory());
    Buffer<Vec2f> by_mean2d(gaussians.count(), gpu().memory());
    gpu().renderer().backward(r.on_gpu.span(), camera, settings, r.gpu, dL.span(), gradients.span(),
                              by_mean2d.span());
    for_each_array(
        [&](const char* name, const auto& array) {
          const std::vector<float> numbers = downloaded(array);
          EXPECT_TRUE(std::all_of(numbers.begin(), numbers.end(), [](float x) {
            return std::isfinite(x);
          })) << name;
        },
        gradients);
  }
};

TEST_F(CudaEdge, NoGaussians) {
  expect_same_picture(Gaussians(0, host_memory()), random_camera(40, 30));
}
TEST_F(CudaEdge, OneThatCoversEveryTile) {
  const Camera camera = plain_camera(300, 200);
  Gaussians one(1, host_memory());
  set_gaussian(one, 0, behind_pixel(camera, 150, 100, 2), 30, 0.7f);
  expect_same_picture(one, camera);
}
TEST_F(CudaEdge, ManyThatCoverEveryTile) {
  const Camera camera = plain_camera(300, 200);
  Gaussians many(100, host_memory());
  for (std::size_t i = 0; i < many.count(); ++i)
    set_gaussian(many, i, behind_pixel(camera, 150, 100, 2 + 0.01f * float(i)), 30, 0.05f);
  expect_same_picture(many, camera);
}
TEST_F(CudaEdge, AllBehindOrCulled) {
  const Camera camera = random_camera(64, 48);
  expect_same_picture(random_gaussians(kBehind, 100, camera, 1), camera);
}
TEST_F(CudaEdge, OnePixel) {
  const Camera camera = random_camera(1, 1);
  expect_same_picture(random_gaussians(kTypical, 50, camera, 1), camera);
}
TEST_F(CudaEdge, SizesAroundATile) {
  for (const int side : {15, 16, 17, 31, 33}) {
    const Camera camera = random_camera(side, 48 - side);
    expect_same_picture(random_gaussians(kTypical, 300, camera, std::uint64_t(side)), camera);
  }
}
TEST_F(CudaEdge, MoreThan65536Tiles) {
  const Camera camera = random_camera(4800, 3600);  // 300 x 225 tiles
  expect_same_picture(random_gaussians(kTypical, 3000, camera, 3), camera);
}
TEST_F(CudaEdge, EqualDepthsKeepTheirOrder) {
  const Camera camera = plain_camera(64, 48);
  Gaussians layers(200, host_memory());
  for (std::size_t i = 0; i < layers.count(); ++i)
    set_gaussian(layers, i, behind_pixel(camera, 32, 24, 3), 0.3f, 0.1f,
                 {float(i % 3) / 2, float(i % 5) / 4, float(i % 7) / 6});
  const Rendered r = render(layers, camera, {});
  EXPECT_EQ(tile_lists(r.gpu), tile_lists(r.cpu));
}
TEST_F(CudaEdge, ScalesBeyondReason) {
  const Camera camera = random_camera(64, 48);
  Gaussians mixed = random_gaussians(kTypical, 200, camera, 9);
  for (std::size_t i = 0; i < mixed.count(); i += 3)
    mixed.log_scale[i] = Vec3f(std::log(i % 2 ? 1e-30f : 1e30f));
  expect_same_picture(mixed, camera);
}
TEST_F(CudaEdge, NotANumberAnywhere) {
  const Camera camera = random_camera(64, 48);
  expect_same_picture(with_bad_numbers(random_gaussians(kTypical, 300, camera, 9)), camera);
}

// A sum of 32 bits would wrap to 65,536 here, which looks like a view that can be sorted.
TEST_F(CudaEdge, MoreThan2To32InstancesAreRefused) {
  const Gaussians many = copy_to(gpu().memory(), model_of_file(gaussians_over_every_tile(65537)));
  RenderPass pass(gpu().memory());
  EXPECT_THAT([&] { gpu().renderer().forward(many.span(), camera_of_65536_tiles(), {}, pass); },
              FailsWith(ExitCode::out_of_memory));
}

}  // namespace
}  // namespace gs
