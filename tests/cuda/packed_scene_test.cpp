// SPDX-License-Identifier: Apache-2.0
// Frames of a packed model against those of its parameters: shapes and lists to the last bit, and
// colors within the rounding of their SH.
#include "tests/support/cuda.h"
#include "tests/support/frames.h"

namespace gs {
namespace {

constexpr int kSplatNumbers = 11;  // of a Splat; behind them it is padded

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

double psnr(const std::vector<float>& a, const std::vector<float>& b) {
  EXPECT_EQ(a.size(), b.size());
  double squares = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    squares += (double(a[i]) - b[i]) * (double(a[i]) - b[i]);
  return squares > 0 ? -10 * std::log10(squares / double(a.size()))
                     : std::numeric_limits<double>::infinity();
}

// Pixel by pixel, splats keep all of their digits.
RenderSettings pixel_by_pixel() {
  RenderSettings settings = for_viewing();
  settings.use_tensor_cores = false;
  return settings;
}
// The camera in the middle of the Gaussians, so that most of them are outside of the picture.
Camera inside(Camera camera, const Gaussians& gaussians) {
  camera.cam_from_world_translation =
      -multiply(camera.cam_from_world_rotation, gaussians.mean[gaussians.count() / 2]);
  return camera;
}

class CudaPackedScene : public CudaTest {
 protected:
  Renderer& renderer() { return gpu().renderer(); }

  void forward(const Gaussians& gaussians, const Camera& camera, const RenderSettings& settings,
               RenderPass& pass) {
    renderer().forward(gaussians.span(), camera, settings, pass);
  }
  void draw(const Gaussians& gaussians, const Camera& camera, const RenderSettings& settings,
            RenderPass& pass) {
    renderer().draw(*renderer().pack(gaussians.span(), settings), camera, settings, pass);
  }
  std::vector<float> picture(const Gaussians& gaussians, const Camera& camera,
                             const RenderSettings& settings) {
    RenderPass pass(gpu().memory());
    draw(gaussians, camera, settings, pass);
    return pass.image.download();
  }

  // Everything but the colors is the same.
  void expect_same(const Gaussians& host, const Camera& camera, const RenderSettings& settings) {
    const Gaussians gaussians = on_gpu(host);
    RenderPass expected(gpu().memory()), actual(gpu().memory());
    forward(gaussians, camera, settings, expected);
    const auto counts = expected.tile_counts.download();
    const auto splats = expected.splats.download();
    draw(gaussians, camera, settings, actual);
    ASSERT_TRUE(same_bits(actual.tile_counts.download(), counts));
    EXPECT_TRUE(same_bits(actual.tile_ranges.download(), expected.tile_ranges.download()));
    expect_same_lists(actual, expected);
    EXPECT_TRUE(same_bits(actual.transmittance.download(), expected.transmittance.download()));
    const auto own_splats = actual.splats.download();
    for (std::size_t i = 0; i < counts.size(); ++i) {
      if (!counts[i]) continue;
      Splat a = own_splats[i], b = splats[i];
      a.color = b.color = Vec3f(0);
      ASSERT_EQ(std::memcmp(&a, &b, kSplatNumbers * sizeof(float)), 0) << i;
    }
    EXPECT_GT(psnr(actual.image.download(), expected.image.download()), 110);
  }
  static void expect_same_lists(const RenderPass& a, const RenderPass& b) {
    const auto ranges = b.tile_ranges.download();
    auto of_a = a.tile_splats.download(), of_b = b.tile_splats.download();
    of_a.resize(ranges.back());  // behind the lists there are spare places
    of_b.resize(ranges.back());
    EXPECT_TRUE(same_bits(of_a, of_b));
  }
};

TEST_F(CudaPackedScene, PlacesSplatsToTheLastBit) {
  const Camera camera = random_camera(320, 240, 3);
  std::uint64_t seed = 0;
  for (const Recipe& recipe :
       {kTypical, kSharp, kNeedles, kHuge, kFaint, kOffScreen, kBehind, kOpaque, kNegativeColors})
    for (const bool has_filter : {false, true})
      for (const bool antialias : {false, true}) {
        SCOPED_TRACE(++seed);
        Gaussians gaussians = random_gaussians(recipe, 3000, camera, seed);
        if (has_filter) gaussians = with_filters(gaussians, seed);
        RenderSettings settings = pixel_by_pixel();
        settings.antialias = antialias;
        expect_same(gaussians, camera, settings);
      }
}

TEST_F(CudaPackedScene, EachDegreeTruncationAndKindOfBounds) {
  const Camera camera = random_camera(320, 240, 3);
  const Gaussians gaussians = random_gaussians(kTypical, 3000, camera, 4);
  for (int degree = 0; degree <= 3; ++degree) {
    RenderSettings settings = pixel_by_pixel();
    settings.sh_degree = degree;
    expect_same(gaussians, camera, settings);
  }
  for (const Truncation truncation : {Truncation::sigma2, Truncation::sigma3, Truncation::sigma4}) {
    RenderSettings settings = pixel_by_pixel();
    settings.truncation = truncation;
    expect_same(gaussians, camera, settings);
  }
  for (const TileBounds bounds : {TileBounds::box, TileBounds::square}) {
    RenderSettings settings = pixel_by_pixel();
    settings.bounds = bounds;
    expect_same(gaussians, camera, settings);
  }
}

// Boxes of 128 rows are skipped; sorted along an axis, many are outside.
TEST_F(CudaPackedScene, FromInsideAndTurnedAway) {
  const Camera camera = random_camera(320, 240, 3);
  for (const Recipe& recipe : {kTypical, kNeedles, kHuge, kOffScreen}) {
    const Gaussians random = random_gaussians(recipe, 20'000, camera, 6);
    std::vector<std::uint32_t> order(random.count());
    for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
    std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
      return random.mean[a].x < random.mean[b].x;
    });
    const Gaussians gaussians = rows_of(random, order);
    for (std::uint64_t seed = 1; seed < 6; ++seed) {
      SCOPED_TRACE(seed);
      expect_same(gaussians, inside(random_camera(320, 240, seed), gaussians), pixel_by_pixel());
    }
    Camera away = camera;
    away.cam_from_world_translation.z -= 1e5f;
    expect_same(gaussians, away, pixel_by_pixel());
  }
}

TEST_F(CudaPackedScene, SmallAndEmptyScenes) {
  const Camera camera = random_camera(160, 120, 3);
  for (const std::size_t count : {0, 1, 31, 32, 33, 127, 128, 129, 257})
    expect_same(random_gaussians(kTypical, count, camera, 9), camera, pixel_by_pixel());
}

TEST_F(CudaPackedScene, NotANumberAnywhere) {
  const Camera camera = random_camera(64, 48);
  Gaussians mixed = with_bad_numbers(random_gaussians(kTypical, 300, camera, 9));
  mixed.rotation[51] = {0, 0, 0, 0};
  mixed.log_scale[100] = Vec3f(std::log(1e30f));
  expect_same(mixed, camera, pixel_by_pixel());
}

TEST_F(CudaPackedScene, OnTensorCoresPicturesAreThoseOfTheParameters) {
  std::uint64_t seed = 0;
  for (const Camera& camera : {random_camera(320, 240, 3), random_camera(1300, 900, 4)})
    for (const Recipe& recipe : {kTypical, kSharp, kHuge, kFaint, kOpaque, kNegativeColors})
      for (const BlendRule rule : {BlendRule::faster_gs, BlendRule::classic}) {
        SCOPED_TRACE(++seed);
        RenderSettings settings = pixel_by_pixel();
        settings.use_tensor_cores = true;
        settings.blend_rule = rule;
        const Gaussians gaussians = on_gpu(random_gaussians(recipe, 3000, camera, seed));
        RenderPass pass(gpu().memory());
        forward(gaussians, camera, settings, pass);
        const std::vector<float> expected = pass.image.download();
        EXPECT_GT(psnr_of_most(picture(gaussians, camera, settings), expected), 105);
      }
}

TEST_F(CudaPackedScene, NeedlesOnTensorCoresLookTheSame) {
  for (const Camera& camera : {random_camera(640, 480, 5), random_camera(1300, 900, 6)}) {
    RenderSettings settings = pixel_by_pixel();
    settings.use_tensor_cores = true;
    const Gaussians gaussians = on_gpu(random_gaussians(kNeedles, 3000, camera, 6));
    RenderPass pass(gpu().memory());
    forward(gaussians, camera, settings, pass);
    EXPECT_GT(psnr_of_most(picture(gaussians, camera, settings), pass.image.download()), 90);
  }
}

// Stage 1 counts tiles and stage 2 lists them, both from splats of 32 bytes.
TEST_F(CudaPackedScene, ListsHoldWhatWasCounted) {
  const Camera large = random_camera(1500, 1100, 4), small = random_camera(640, 480, 4);
  RenderSettings settings = pixel_by_pixel();
  settings.use_tensor_cores = true;
  for (const TileBounds bounds : {TileBounds::exact, TileBounds::box, TileBounds::square})
    for (const Recipe& recipe : {kTypical, kSharp, kNeedles, kHuge, kOffScreen})
      for (const Camera& camera : {large, small}) {
        settings.bounds = bounds;
        const Gaussians gaussians = on_gpu(random_gaussians(recipe, 3000, camera, 8));
        RenderPass expected(gpu().memory()), actual(gpu().memory());
        forward(gaussians, camera, settings, expected);
        draw(gaussians, camera, settings, actual);
        const auto counts = actual.tile_counts.download(), ranges = actual.tile_ranges.download();
        const auto own_counts = expected.tile_counts.download();
        std::vector<std::uint32_t> listed(counts.size());
        const auto splats = actual.tile_splats.download();
        const bool is_wide = camera.width == large.width && bounds != TileBounds::square;
        ASSERT_EQ(actual.tile_edge, is_wide ? kWideTile : kTileWidth);
        for (std::uint32_t k = 0; k < ranges.back(); ++k)
          ++listed[is_wide ? gaussian_of<kWideTile>(splats[k]) : gaussian_of(splats[k])];
        EXPECT_EQ(listed, counts);
        double instances = 0, own_instances = 0, differ = 0, seen_by_one = 0;
        for (std::size_t i = 0; i < counts.size(); ++i) {
          instances += counts[i];
          own_instances += own_counts[i];
          differ += std::abs(double(counts[i]) - own_counts[i]);
          seen_by_one += (counts[i] > 0) != (own_counts[i] > 0);
        }
        if (is_wide) {
          // Beside the picture, wide tiles end elsewhere.
          EXPECT_LE(instances, own_instances);
          EXPECT_LE(seen_by_one, double(counts.size()) / 50);
        } else {
          // A tile that a splat hardly touches may be listed by one of them only.
          EXPECT_LE(differ, 2e-3 * own_instances + 1);
        }
      }
}

// Wide tiles list the splats of each part in the same order as others.
TEST_F(CudaPackedScene, WideTilesShowTheSame) {
  for (const auto& [width, height] : {std::pair(1500, 1100), {1209, 1301}, {4000, 401}}) {
    const Camera camera = random_camera(width, height, 4);
    int number = 0;
    for (const TileBounds bounds : {TileBounds::exact, TileBounds::box})
      for (const Recipe& recipe : {kTypical, kSharp, kNeedles, kHuge, kOffScreen}) {
        RenderSettings settings = pixel_by_pixel();
        settings.use_tensor_cores = true;
        settings.bounds = bounds;
        SCOPED_TRACE(testing::Message()
                     << width << ", bounds " << int(bounds) << ", recipe " << ++number);
        const Gaussians gaussians = on_gpu(random_gaussians(recipe, 3000, camera, 8));
        RenderPass wide(gpu().memory()), narrow(gpu().memory());
        draw(gaussians, camera, settings, wide);
        forward(gaussians, camera, settings, narrow);
        ASSERT_EQ(wide.tile_edge, kWideTile);
        ASSERT_EQ(narrow.tile_edge, kTileWidth);
        // A splat in vain in a list moves the splats behind it to other batches. Where rounding
        // makes a tile lose the edge of a needle, the tiles decide where that is.
        const double decibels = recipe.stretch == kNeedles.stretch ? 80 : 105;
        EXPECT_GT(psnr_of_most(wide.image.download(), narrow.image.download()), decibels);
        EXPECT_GT(psnr_of_most(wide.transmittance.download(), narrow.transmittance.download()),
                  decibels);
      }
  }
}

TEST_F(CudaPackedScene, WhatIsNotPackedIsDrawnFromItsParameters) {
  Camera camera = random_camera(160, 120, 3);
  camera.time = 0.5f;
  const Gaussians still = random_gaussians(kTypical, 2000, camera, 9);
  const RenderSettings settings = pixel_by_pixel();
  {
    const Gaussians gaussians = on_gpu(in_spacetime(still, 7));
    RenderPass pass(gpu().memory());
    forward(gaussians, camera, settings, pass);
    EXPECT_TRUE(same_bits(picture(gaussians, camera, settings), pass.image.download()));
  }
  // Another SH degree than it was packed with, and a frame for the backward pass.
  const Gaussians gaussians = on_gpu(still);
  const auto packed = renderer().pack(gaussians.span(), settings);
  RenderSettings other = settings, training = settings;
  other.sh_degree = 1;
  training.for_backward = true;
  for (const RenderSettings& own : {other, training}) {
    RenderPass actual(gpu().memory()), expected(gpu().memory());
    renderer().draw(*packed, camera, own, actual);
    forward(gaussians, camera, own, expected);
    EXPECT_TRUE(same_bits(actual.image.download(), expected.image.download()));
  }
}

TEST_F(CudaPackedScene, WithoutMemoryForItTheParametersAreDrawn) {
  const Camera camera = random_camera(160, 120, 3);
  const Gaussians gaussians = on_gpu(random_gaussians(kTypical, 2000, camera, 9));
  const RenderSettings settings = pixel_by_pixel();
  RenderPass actual(gpu().memory()), expected(gpu().memory());
  forward(gaussians, camera, settings, expected);
  set_allocation_hook(
      [](std::size_t) { throw Error("there is no memory", ExitCode::out_of_memory); });
  std::unique_ptr<PackedScene> packed;
  EXPECT_NO_THROW(packed = renderer().pack(gaussians.span(), settings));
  set_allocation_hook(nullptr);
  ASSERT_TRUE(packed);
  renderer().draw(*packed, camera, settings, actual);
  EXPECT_TRUE(same_bits(actual.image.download(), expected.image.download()));
}

TEST_F(CudaPackedScene, FramesOfAPathAreThoseDrawnAlone) {
  const Gaussians host = random_gaussians(kTypical, 20'000, random_camera(640, 480, 3), 6);
  const Gaussians gaussians = on_gpu(host);
  RenderSettings settings = pixel_by_pixel();
  settings.use_tensor_cores = true;
  const auto packed = renderer().pack(gaussians.span(), settings);
  RenderPass pass(gpu().memory());
  for (int frame = 0; frame < 12; ++frame) {
    Camera camera = random_camera(640, 480, 3);
    camera.cam_from_world_translation.x += 0.02f * float(frame);
    if (frame == 7) camera.cam_from_world_translation.z -= 1e5f;  // a cut, and back
    renderer().draw(*packed, camera, settings, pass);
    const std::vector<float> actual = pass.image.download();
    const std::unique_ptr<Backend> fresh = cuda::make_backend({0});  // counts its instances
    RenderPass alone(fresh->memory());
    fresh->renderer().draw(*fresh->renderer().pack(gaussians.span(), settings), camera, settings,
                           alone);
    EXPECT_TRUE(same_bits(actual, alone.image.download())) << frame;
  }
}

}  // namespace
}  // namespace gs
