// SPDX-License-Identifier: Apache-2.0
// Frames with lists by bins: the lists are those of gs_render/bin_lists.h, each sub-tile has the
// splats that lists by tiles give it, and pictures are the same to the last bit.
#include <gtest/gtest.h>

#include <bit>

#include "cuda/render/view_scratch.h"
#include "gs_core/error.h"
#include "gs_core/math/projection.h"
#include "gs_render/bin_lists.h"
#include "tests/support/bin_cases.h"
#include "tests/support/cuda.h"
#include "tests/support/frames.h"

namespace gs {
namespace {

constexpr int kSides[] = {32, 64};

RenderSettings by_bins(RenderSettings settings, int side) {
  settings.bin_side = side;
  return settings;
}
RenderSettings counted(RenderSettings settings) {
  settings.counted_frames = true;
  return settings;
}

// Gaussians one behind the other at the same depth, in the middle of the picture.
Gaussians at_one_depth(std::size_t count, const Camera& camera) {
  Gaussians layers(count, host_memory());
  for (std::size_t i = 0; i < count; ++i)
    set_gaussian(layers, i,
                 behind_pixel(camera, float(camera.width) / 2, float(camera.height) / 2, 3), 0.3f,
                 0.01f);
  return layers;
}

// The GPU's lists in the form of the reference.
BinLists lists_of(const cuda::BinBuffers& bins) {
  BinLists lists;
  lists.bin_side = bins.side;
  lists.bins_x = bins.bins_x;
  lists.bins_y = bins.bins_y;
  lists.ranges = bins.ranges.download();
  lists.rows = bins.rows.download();
  lists.words = bins.words.download();
  for (const std::uint32_t group : bins.first_groups.download())
    lists.first_word.push_back(std::size_t(group) * std::size_t(lists.subtiles()));
  // Behind the lists there are spare places.
  EXPECT_GE(lists.rows.size(), lists.ranges.back());
  EXPECT_GE(lists.words.size(), lists.first_word.back());
  lists.rows.resize(lists.ranges.back());
  lists.words.resize(lists.first_word.back());
  return lists;
}

// The reference, from what stage 1 has left of a frame.
BinLists expected_lists(const RenderPass& drawn, const Gaussians& gaussians, const Camera& camera,
                        const RenderSettings& settings) {
  RenderPass pass;
  pass.begin(camera, gaussians.count());
  const auto counts = drawn.tile_counts.download();
  const auto rects = drawn.pixel_rects.download();
  const auto splats = drawn.scratch<cuda::ViewScratch>().view_splats.download();
  for (std::size_t i = 0; i < counts.size(); ++i) {
    pass.tile_counts[i] = counts[i];
    if (counts[i] == 0) continue;
    const SplatOutline outline = outline_of(splats[i]);
    pass.splats[i].mean2d = outline.mean2d;
    pass.splats[i].conic = outline.conic;
    pass.splats[i].cutoff = outline.cutoff;
    pass.pixel_rects[i] = rects[i];
    pass.depths[i] = to_camera(camera, gaussians.mean[i]).z;
  }
  return bin_lists(settings, pass, settings.bin_side);
}

std::size_t bits_set(const std::vector<std::uint32_t>& words) {
  std::size_t bits = 0;
  for (const std::uint32_t word : words) bits += std::size_t(std::popcount(word));
  return bits;
}
std::size_t bits_that_differ(const std::vector<std::uint32_t>& a,
                             const std::vector<std::uint32_t>& b) {
  std::size_t bits = 0;
  for (std::size_t k = 0; k < a.size(); ++k) bits += std::size_t(std::popcount(a[k] ^ b[k]));
  return bits;
}

class CudaBins : public CudaTest {
 protected:
  void draw(const PackedScene& scene, const Camera& camera, const RenderSettings& settings,
            RenderPass& pass) {
    gpu().renderer().draw(scene, camera, settings, pass);
  }
  Picture picture(const PackedScene& scene, const Camera& camera, const RenderSettings& settings) {
    RenderPass pass(gpu().memory());
    draw(scene, camera, settings, pass);
    return {pass.image.download(), pass.transmittance.download()};
  }

  // The lists of the reference, entry by entry. Words are those of lists by tiles to the last bit;
  // the quick quotients of both may differ in rare bits from the reference.
  void expect_lists(const Gaussians& host, const Camera& camera, const RenderSettings& settings) {
    const Gaussians gaussians = on_gpu(host);
    const auto scene = gpu().renderer().pack(gaussians.span(), settings);
    RenderPass by_tiles(gpu().memory());
    draw(*scene, camera, settings, by_tiles);
    for (const int side : kSides) {
      SCOPED_TRACE(side);
      RenderPass pass(gpu().memory());
      const RenderSettings own = by_bins(settings, side);
      draw(*scene, camera, own, pass);
      const BinLists actual = lists_of(pass.scratch<cuda::ViewScratch>().bins);
      const BinLists expected = expected_lists(pass, host, camera, own);
      ASSERT_EQ(actual.ranges, expected.ranges);
      ASSERT_EQ(actual.rows, expected.rows);
      ASSERT_EQ(actual.first_word, expected.first_word);
      ASSERT_EQ(actual.words.size(), expected.words.size());
      EXPECT_LE(bits_that_differ(actual.words, expected.words),
                std::size_t(1e-3 * double(bits_set(expected.words))) + 1);
      expect_subtiles(actual, by_tiles);
    }
  }
  void expect_subtiles(const BinLists& lists, const RenderPass& by_tiles) {
    const auto ranges = by_tiles.tile_ranges.download(),
               instances = by_tiles.tile_splats.download();
    for (int y = 0; y * kSubtileSide < by_tiles.height; ++y)
      for (int x = 0; x * kSubtileSide < by_tiles.width; ++x) {
        const std::size_t tile = std::size_t(y / 2) * by_tiles.tiles_x + x / 2;
        Rows expected;
        for (std::uint32_t k = ranges[tile]; k < ranges[tile + 1]; ++k)
          if (instances[k] & bit_of_quarter(x % 2 + 2 * (y % 2)))
            expected.push_back(gaussian_of(instances[k]));
        ASSERT_EQ(list_of_subtile(lists, x, y), expected) << x << ", " << y;
      }
  }

  // The first two frames by bins count their entries, the others do not.
  void expect_same_pictures(const Gaussians& host, const Camera& camera,
                            const RenderSettings& settings) {
    const Gaussians gaussians = on_gpu(host);
    const auto scene = gpu().renderer().pack(gaussians.span(), settings);
    const Picture expected = picture(*scene, camera, settings);
    for (const int side : kSides)
      for (int frame = 0; frame < 4; ++frame)
        EXPECT_TRUE(picture(*scene, camera, by_bins(settings, side)) == expected)
            << "bins of " << side << " pixels, frame " << frame;
  }
};

TEST_F(CudaBins, ListsAreThoseOfTheReference) {
  for_each_recipe_and_bounds(
      3000, 600, 410, for_viewing(),
      [&](const Gaussians& gaussians, const Camera& camera, const RenderSettings& settings) {
        expect_lists(gaussians, camera, settings);
      });
}

TEST_F(CudaBins, ListsOfPicturesOfAnySize) {
  for_each_small_picture(700, [&](const Gaussians& gaussians, const Camera& camera) {
    expect_lists(gaussians, camera, for_viewing());
  });
}

TEST_F(CudaBins, ListsOfEmptyAndSmallScenes) {
  const Camera camera = plain_camera(200, 130);
  for (const std::size_t count : {0, 1, 2, 31, 32, 33, 127, 129})
    expect_lists(random_gaussians(kTypical, count, camera, 5), camera, for_viewing());
}

// Shared memory holds 8,192 entries; longer lists are sorted in global memory.
TEST_F(CudaBins, ListsBelowAndAboveWhatSharedMemoryHolds) {
  const Camera camera = plain_camera(40, 40);
  for (const std::size_t count : {500, 4097, 8191, 8192, 8193, 20'000}) {
    SCOPED_TRACE(count);
    expect_lists(random_gaussians(kHuge, count, camera, 3), camera, for_viewing());
  }
}

// No exchange of neighbors brings so many equal keys into order: they need the other sort.
TEST_F(CudaBins, EqualDepthsKeepTheOrderOfTheirRows) {
  const Camera camera = plain_camera(64, 48);
  for (const std::size_t count : {20, 200, 3000, 8192, 9000}) {
    SCOPED_TRACE(count);
    expect_lists(at_one_depth(count, camera), camera, for_viewing());
  }
}

// One splat far behind the others takes nearly the whole range of 16 bits.
TEST_F(CudaBins, DepthsThatTheReducedKeysDoNotTellApart) {
  Camera camera = plain_camera(64, 48);
  Gaussians layers = at_one_depth(2000, camera);
  for (std::size_t i = 0; i < layers.count(); ++i)
    layers.mean[i].z += 1e-5f * float(i * 7919 % layers.count());
  set_gaussian(layers, 0, behind_pixel(camera, 32, 24, 5e3f), 1000, 0.5f);
  expect_lists(layers, camera, for_viewing());
  expect_same_pictures(layers, camera, for_viewing());
}

TEST_F(CudaBins, OneGaussianOverEverything) {
  const Camera camera = camera_of_65536_tiles();
  const Gaussians one = gaussians_over_every_tile(1);
  expect_same_pictures(one, camera, for_viewing());
  const Camera smaller = plain_camera(700, 500);
  expect_lists(one, smaller, for_viewing());
  expect_lists(joined(random_gaussians(kTypical, 1000, smaller, 2), one), smaller, for_viewing());
}

// A warp has 8 x 4 pixels of the smaller picture, and 8 x 8 of the larger one.
TEST_F(CudaBins, PicturesAreThoseOfTilesToTheLastBit) {
  std::uint64_t seed = 0;
  for (const Camera& camera : {random_camera(320, 240, 3), random_camera(1300, 900, 4)})
    for (const Recipe& recipe : kBinRecipes)
      for (const BlendRule rule : {BlendRule::faster_gs, BlendRule::classic})
        for (const bool fast_blending : {false, true}) {
          SCOPED_TRACE(++seed);
          RenderSettings settings = for_viewing();
          settings.blend_rule = rule;
          settings.fast_blending = fast_blending;
          expect_same_pictures(random_gaussians(recipe, 3000, camera, seed), camera, settings);
        }
}

TEST_F(CudaBins, PicturesOfLongListsThatCloseAndOfOddSizes) {
  for (const int side : {1, 17, 150, 901, 1800}) {
    SCOPED_TRACE(side);
    const Camera camera = random_camera(4 * side / 3 + 1, side, 5);
    expect_same_pictures(random_gaussians(kTypical, 20'000, camera, 8), camera, for_viewing());
    expect_same_pictures(random_gaussians(kOpaque, 20'000, camera, 9), camera, for_viewing());
  }
}

TEST_F(CudaBins, PicturesOfEmptyAndSmallScenes) {
  const Camera camera = random_camera(160, 120, 3);
  for (const std::size_t count : {0, 1, 31, 33})
    expect_same_pictures(random_gaussians(kTypical, count, camera, 9), camera, for_viewing());
}

TEST_F(CudaBins, AnOverflowIsDrawnAgain) {
  const Camera camera = random_camera(640, 480, 3);
  Camera away = camera;
  away.cam_from_world_translation.z -= 1e5f;
  const Gaussians gaussians = on_gpu(random_gaussians(kHuge, 2000, camera, 4));
  for (const int side : kSides) {
    const RenderSettings settings = by_bins(for_viewing(), side);
    const auto scene = gpu().renderer().pack(gaussians.span(), settings);
    const Picture expected = picture(*scene, camera, counted(settings)),
                  nothing = picture(*scene, away, counted(settings));
    EXPECT_FALSE(expected == nothing);
    for (int round = 0; round < 2; ++round) {
      for (int frame = 0; frame < 3; ++frame)
        EXPECT_TRUE(picture(*scene, away, settings) == nothing);
      for (int frame = 0; frame < 3; ++frame)
        EXPECT_TRUE(picture(*scene, camera, settings) == expected);
    }
  }
}

TEST_F(CudaBins, FramesOfAPathAreThoseDrawnByTiles) {
  const Gaussians gaussians =
      on_gpu(random_gaussians(kTypical, 20'000, random_camera(640, 480, 3), 6));
  const RenderSettings settings = for_viewing();
  const auto scene = gpu().renderer().pack(gaussians.span(), settings);
  RenderPass pass(gpu().memory());
  for (int frame = 0; frame < 12; ++frame) {
    Camera camera = random_camera(640, 480, 3);
    camera.cam_from_world_translation.x += 0.02f * float(frame);
    if (frame == 7) camera.cam_from_world_translation.z -= 1e5f;  // a cut, and back
    draw(*scene, camera, settings, pass);
    const std::vector<float> expected = pass.image.download();
    for (const int side : kSides) {
      draw(*scene, camera, by_bins(settings, side), pass);
      EXPECT_EQ(pass.image.download(), expected) << frame;
    }
  }
}

TEST_F(CudaBins, FramesWithoutSmallSplatsIgnoreTheSwitch) {
  const Camera camera = random_camera(320, 240, 3);
  const Gaussians gaussians = on_gpu(random_gaussians(kTypical, 3000, camera, 6));
  for (const bool use_tensor_cores : {false, true}) {
    RenderSettings settings = for_viewing();
    settings.use_tensor_cores = use_tensor_cores;
    settings.full_splats = use_tensor_cores;
    const auto scene = gpu().renderer().pack(gaussians.span(), settings);
    EXPECT_TRUE(picture(*scene, camera, by_bins(settings, 32)) ==
                picture(*scene, camera, settings));
  }
}

TEST_F(CudaBins, MoreThan2To31EntriesAreRefused) {
  const Gaussians many = on_gpu(gaussians_over_every_tile(200'000));
  const RenderSettings settings = by_bins(for_viewing(), 32);
  const auto scene = gpu().renderer().pack(many.span(), settings);
  try {
    picture(*scene, camera_of_65536_tiles(), settings);
    ADD_FAILURE() << "nothing was refused";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::out_of_memory);
  }
}

}  // namespace
}  // namespace gs
