// SPDX-License-Identifier: Apache-2.0
// The lists of bins against the lists of tiles: each sub-tile has the same splats in the same
// order.
#include "gs_render/bin_lists.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "gs_render/renderer.h"
#include "tests/support/bin_cases.h"

namespace gs {
namespace {

void render(const Gaussians& gaussians, const Camera& camera, const RenderSettings& settings,
            RenderPass& pass) {
  make_scalar_renderer()->forward(gaussians.span(), camera, settings, pass);
}

Rows list_of_tile(const RenderPass& pass, int tile_x, int tile_y) {
  const std::size_t tile = std::size_t(tile_y) * pass.tiles_x + tile_x;
  return {pass.tile_splats.data() + pass.tile_ranges[tile],
          pass.tile_splats.data() + pass.tile_ranges[tile + 1]};
}

// The splats of a sub-tile as the GPU finds them today: those of its tile that hit its quarter.
Rows list_of_quarter(const RenderPass& pass, int x, int y) {
  Rows rows;
  for (const std::uint32_t row : list_of_tile(pass, x / 2, y / 2)) {
    const Splat& splat = pass.splats[row];
    const unsigned quarters =
        hit_quarters_of_row(splat.mean2d, splat.conic, splat.cutoff, y / 2).quarters_of(x / 2);
    if (quarters >> (x % 2 + 2 * (y % 2)) & 1) rows.push_back(row);
  }
  return rows;
}

void expect_same_lists(const Gaussians& gaussians, const Camera& camera,
                       const RenderSettings& settings = {}) {
  RenderPass pass;
  render(gaussians, camera, settings, pass);
  for (const int side : {32, 64}) {
    SCOPED_TRACE(side);
    const BinLists lists = bin_lists(settings, pass, side);
    for (int y = 0; y * kSubtileSide < camera.height; ++y)
      for (int x = 0; x * kSubtileSide < camera.width; ++x)
        ASSERT_EQ(list_of_subtile(lists, x, y), list_of_quarter(pass, x, y)) << x << ", " << y;
  }
}

TEST(BinLists, SubtilesHaveTheListsOfTheirTiles) {
  for_each_recipe_and_bounds(800, 200, 130, {}, expect_same_lists);
}

TEST(BinLists, PicturesOfAnySize) {
  for_each_small_picture(300, [](const Gaussians& gaussians, const Camera& camera) {
    expect_same_lists(gaussians, camera);
  });
}

TEST(BinLists, EmptyScenesAndOneSplat) {
  const Camera camera = plain_camera(100, 70);
  for (const std::size_t count : {0, 1, 31, 32, 33})
    expect_same_lists(random_gaussians(kTypical, count, camera, 5), camera);
}

TEST(BinLists, EqualDepthsKeepTheirOrder) {
  const Camera camera = plain_camera(64, 48);
  Gaussians layers(200, host_memory());
  for (std::size_t i = 0; i < layers.count(); ++i)
    set_gaussian(layers, i, behind_pixel(camera, 32, 24, 3), 0.3f, 0.1f);
  expect_same_lists(layers, camera);
  RenderPass pass;
  render(layers, camera, {}, pass);
  const Rows rows = list_of_subtile(bin_lists({}, pass, 64), 4, 3);
  EXPECT_EQ(rows.size(), layers.count());
  EXPECT_TRUE(std::is_sorted(rows.begin(), rows.end()));
}

// A GPU sorts up to 8,192 entries of a bin in shared memory.
TEST(BinLists, BinsOfMoreThan8192Entries) {
  const Camera camera = plain_camera(40, 40);
  expect_same_lists(random_gaussians(kHuge, 9000, camera, 3), camera);
}

TEST(BinLists, ABinListsASplatOnce) {
  const Camera camera = random_camera(200, 130, 3);
  RenderPass pass;
  render(random_gaussians(kNeedles, 2000, camera, 4), camera, {}, pass);
  for (const int side : {32, 64}) {
    const BinLists lists = bin_lists({}, pass, side);
    for (std::size_t bin = 0; bin + 1 < lists.ranges.size(); ++bin) {
      const auto begin = lists.rows.begin() + lists.ranges[bin],
                 end = lists.rows.begin() + lists.ranges[bin + 1];
      EXPECT_EQ(std::set<std::uint32_t>(begin, end).size(), std::size_t(end - begin));
    }
  }
}

TEST(BinLists, LargerBinsHaveFewerEntries) {
  const Camera camera = random_camera(640, 480, 3);
  RenderPass pass;
  render(random_gaussians(kTypical, 3000, camera, 4), camera, {}, pass);
  const std::size_t of_32 = bin_lists({}, pass, 32).rows.size(),
                    of_64 = bin_lists({}, pass, 64).rows.size();
  EXPECT_LT(of_64, of_32);
  EXPECT_LT(of_32, pass.tile_splats.size());
  EXPECT_GE(of_64, pass.depth_order.size());
}

// What a sub-tile leaves out of its tile's list is invisible at every one of its pixels.
TEST(BinLists, NoFragmentIsLost) {
  const Camera camera = random_camera(160, 120, 3);
  for (const Recipe& recipe : {kTypical, kSharp, kHuge, kFaint}) {
    RenderPass pass;
    render(random_gaussians(recipe, 1000, camera, 4), camera, {}, pass);
    const BinLists lists = bin_lists({}, pass, 32);
    std::size_t fragments = 0;
    for (int y = 0; y < camera.height; ++y)
      for (int x = 0; x < camera.width; ++x) {
        const auto visible = [&](const Rows& rows) {
          Rows kept;
          for (const std::uint32_t row : rows) {
            const Splat& splat = pass.splats[row];
            const float dx = float(x) + 0.5f - splat.mean2d.x,
                        dy = float(y) + 0.5f - splat.mean2d.y;
            if (fragment_exponent(splat.conic, dx, dy) >= -splat.cutoff) kept.push_back(row);
          }
          return kept;
        };
        const Rows all = visible(list_of_tile(pass, x / kTileWidth, y / kTileHeight));
        ASSERT_EQ(visible(list_of_subtile(lists, x / kSubtileSide, y / kSubtileSide)), all);
        fragments += all.size();
      }
    EXPECT_GT(fragments, 1000u);
  }
}

}  // namespace
}  // namespace gs
