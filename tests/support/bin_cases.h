// SPDX-License-Identifier: Apache-2.0
// What tests of lists by bins share: the scenes, and the list of a sub-tile.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "gs_render/bin_lists.h"
#include "tests/support/scenes.h"

namespace gs {

inline constexpr Recipe kBinRecipes[] = {kTypical, kSharp,     kNeedles, kHuge,
                                         kFaint,   kOffScreen, kBehind};

using Rows = std::vector<std::uint32_t>;

inline Rows list_of_subtile(const BinLists& lists, int x, int y) {
  Rows rows;
  lists.for_each_splat(x, y, [&](std::uint32_t row) { rows.push_back(row); });
  return rows;
}

/// Calls expect(gaussians, camera, settings) for each kind of Gaussians with each kind of bounds,
/// the latter in `settings`.
template <class Expect>
void for_each_recipe_and_bounds(std::size_t count, int width, int height, RenderSettings settings,
                                Expect&& expect) {
  std::uint64_t seed = 0;
  for (const Recipe& recipe : kBinRecipes)
    for (const TileBounds bounds : {TileBounds::exact, TileBounds::box, TileBounds::square}) {
      SCOPED_TRACE(++seed);
      settings.bounds = bounds;
      settings.antialias = seed % 2;
      const Camera camera = random_camera(width, height, seed);
      expect(random_gaussians(recipe, count, camera, seed), camera, settings);
    }
}

/// Calls expect(gaussians, camera) for pictures around the sides of sub-tiles and bins.
template <class Expect>
void for_each_small_picture(std::size_t count, Expect&& expect) {
  for (const int side : {1, 8, 9, 16, 31, 32, 33, 63, 64, 65, 129}) {
    SCOPED_TRACE(side);
    const Camera camera = random_camera(side, 130 - side, std::uint64_t(side));
    expect(random_gaussians(kTypical, count, camera, 5), camera);
  }
}

}  // namespace gs
