// SPDX-License-Identifier: Apache-2.0
// Stages 2 and 3: instances, their order by depth and by tile, and the radix sort that they use.
#include "gs_core/threads/radix_sort.h"
#include "gs_render/stages.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

/// Stages 1 to 3.
RenderPass sorted_pass(const Gaussians& gaussians, const Camera& camera) {
  RenderPass pass;
  preprocess(gaussians.span(), camera, {}, pass);
  create_instances({}, pass);
  sort_by_tile(pass);
  return pass;
}

/// Gaussians of every kind, each depth shared by some.
Gaussians gaussians_with_equal_depths(const Camera& camera) {
  const Gaussians once = mixed_gaussians(40, camera, 1);
  return joined(once, joined(random_gaussians(kTypical, 40, camera, 9), once));
}

class SortedPass : public ::testing::Test {
 protected:
  const Camera camera_ = random_camera(150, 90);
  const Gaussians gaussians_ = gaussians_with_equal_depths(camera_);
  const RenderPass pass_ = sorted_pass(gaussians_, camera_);
  const ScalarScratch& scratch_ = pass_.scratch<ScalarScratch>();
};

TEST_F(SortedPass, DepthOrderHoldsTheVisibleNearToFarAndEqualDepthsByIndex) {
  std::vector<std::uint32_t> expected;
  for (std::uint32_t i = 0; i < gaussians_.count(); ++i)
    if (pass_.tile_counts[i]) expected.push_back(i);
  std::stable_sort(expected.begin(), expected.end(),
                   [&](auto a, auto b) { return pass_.splats[a].depth < pass_.splats[b].depth; });
  EXPECT_GT(expected.size(), 300u);
  EXPECT_EQ(pass_.depth_order.download(), expected);
}

TEST_F(SortedPass, InstancesOfASplatAreTheTilesThatItHits) {
  ASSERT_EQ(scratch_.first_instance.size(), gaussians_.count());
  std::uint32_t instance = 0;
  for (const std::uint32_t i : pass_.depth_order) {
    const Splat& splat = pass_.splats[i];
    const Rect tiles = tile_rect(pass_.pixel_rects[i]);
    ASSERT_EQ(scratch_.first_instance[i], instance);
    for (int y = 0; y < pass_.tiles_y; ++y)
      for (int x = 0; x < pass_.tiles_x; ++x) {
        if (x < tiles.x_begin || x >= tiles.x_end || y < tiles.y_begin || y >= tiles.y_end)
          continue;
        if (!tile_is_hit(splat.mean2d, splat.conic, splat.cutoff, x, y)) continue;
        ASSERT_LT(instance, scratch_.first_instance[i] + pass_.tile_counts[i]);
        EXPECT_EQ(scratch_.instance_tiles[instance], std::uint32_t(y * pass_.tiles_x + x));
        EXPECT_EQ(scratch_.instance_splats[instance], i);
        ++instance;
      }
    EXPECT_EQ(pass_.tile_counts[i], instance - scratch_.first_instance[i]);
  }
  EXPECT_EQ(instance, scratch_.instance_splats.size());
}

TEST_F(SortedPass, EveryPixelOfASplatLiesInOneOfItsTiles) {
  std::size_t fragments = 0;
  for (const std::uint32_t i : pass_.depth_order) {
    const Splat& s = pass_.splats[i];
    std::vector<bool> has_instance(pass_.tile_count());
    for (std::uint32_t n = 0; n < pass_.tile_counts[i]; ++n)
      has_instance[scratch_.instance_tiles[scratch_.first_instance[i] + n]] = true;
    for (int y = 0; y < pass_.height; ++y)
      for (int x = 0; x < pass_.width; ++x) {
        const double dx = x + 0.5 - s.mean2d.x, dy = y + 0.5 - s.mean2d.y;
        const double terms = 0.5 * (s.conic.xx * dx * dx + s.conic.yy * dy * dy);
        // The float test of tiles may round terms that cancel by 1e-6.
        if (terms + s.conic.xy * dx * dy > s.cutoff - 1e-6 * (1 + 2 * terms)) continue;
        ++fragments;
        EXPECT_TRUE(has_instance[y / kTileHeight * pass_.tiles_x + x / kTileWidth])
            << x << " " << y;
      }
  }
  EXPECT_GT(fragments, 100'000u);
}

TEST_F(SortedPass, RangesHoldEachInstanceOnceInTheListOfItsTile) {
  ASSERT_EQ(pass_.tile_ranges.size(), pass_.tile_count() + 1);
  EXPECT_EQ(pass_.tile_ranges[0], 0u);
  EXPECT_EQ(pass_.tile_ranges[pass_.tile_count()], scratch_.instance_tiles.size());
  for (std::uint32_t tile = 0; tile < pass_.tile_count(); ++tile)
    for (std::uint32_t k = pass_.tile_ranges[tile]; k < pass_.tile_ranges[tile + 1]; ++k)
      EXPECT_EQ(scratch_.instance_tiles[scratch_.tile_instances[k]], tile);
  std::vector<std::uint32_t> all = scratch_.tile_instances.download();
  std::sort(all.begin(), all.end());
  for (std::uint32_t i = 0; i < all.size(); ++i) EXPECT_EQ(all[i], i);
}

TEST_F(SortedPass, EachTileListRunsNearToFarAndEqualDepthsByIndex) {
  std::size_t ties = 0;
  for (std::uint32_t tile = 0; tile < pass_.tile_count(); ++tile)
    for (std::uint32_t k = pass_.tile_ranges[tile] + 1; k < pass_.tile_ranges[tile + 1]; ++k) {
      const std::uint32_t a = scratch_.instance_splats[scratch_.tile_instances[k - 1]];
      const std::uint32_t b = scratch_.instance_splats[scratch_.tile_instances[k]];
      EXPECT_LE(pass_.splats[a].depth, pass_.splats[b].depth);
      EXPECT_TRUE(pass_.splats[a].depth < pass_.splats[b].depth || a < b);
      ties += pass_.splats[a].depth == pass_.splats[b].depth;
    }
  EXPECT_GT(ties, 500u);
}

// 2^31 twice: the sum overflows to 0 in 32 bits.
TEST(CreateInstances, RefusesMoreThanCanBeNumbered) {
  RenderPass pass;
  pass.tile_counts.upload({1u << 31, 1u << 31});
  pass.splats.resize(2);
  EXPECT_THAT([&] { create_instances({}, pass); }, FailsWith(ExitCode::out_of_memory));
}

TEST(SortByTile, OfNothingLeavesEmptyRanges) {
  const RenderPass pass = sorted_pass(Gaussians(), random_camera(40, 20));
  EXPECT_EQ(pass.tile_ranges.download(), std::vector<std::uint32_t>(pass.tile_count() + 1, 0));
}

/// Sorts 0 .. n-1 by the keys in both ways.
template <class Key>
void expect_stable_sort(const std::vector<Key>& keys) {
  Buffer<std::uint32_t> indices(keys.size(), host_memory()), scratch;
  for (std::size_t i = 0; i < keys.size(); ++i) indices[i] = std::uint32_t(i);
  std::vector<std::uint32_t> expected = indices.download();
  radix_sort_by_key(indices.span(), scratch, [&](std::uint32_t i) { return keys[i]; });
  std::stable_sort(expected.begin(), expected.end(),
                   [&](auto a, auto b) { return keys[a] < keys[b]; });
  EXPECT_EQ(indices.download(), expected);
}

template <class Key>
class RadixSort : public ::testing::Test {};
using KeyTypes = ::testing::Types<std::uint32_t, std::uint64_t>;
TYPED_TEST_SUITE(RadixSort, KeyTypes);

TYPED_TEST(RadixSort, SortsRandomKeys) {
  std::mt19937_64 random(1);
  for (const std::size_t count : {0, 1, 2, 3, 1000, 100'000}) {
    std::vector<TypeParam> keys(count);
    for (TypeParam& key : keys) key = TypeParam(random());
    expect_stable_sort(keys);
  }
}

TYPED_TEST(RadixSort, KeepsTheOrderOfEqualKeys) {
  std::mt19937_64 random(2);
  std::vector<TypeParam> keys(10'000);
  for (TypeParam& key : keys) key = TypeParam(random() % 7) << (8 * sizeof(TypeParam) - 4);
  expect_stable_sort(keys);
}

TYPED_TEST(RadixSort, SortsByEachBitAlone) {
  for (std::size_t bit = 0; bit < 8 * sizeof(TypeParam); ++bit)
    expect_stable_sort(std::vector<TypeParam>{TypeParam(1) << bit, 0, TypeParam(1) << bit, 0});
}

TYPED_TEST(RadixSort, LeavesEqualAndSortedKeysAlone) {
  expect_stable_sort(std::vector<TypeParam>(1000, TypeParam(-1)));
  expect_stable_sort(std::vector<TypeParam>{0, 1, 2, 3000, TypeParam(-2), TypeParam(-1)});
}

}  // namespace
}  // namespace gs
