// SPDX-License-Identifier: Apache-2.0
// The window of cuda/render/blend/pixel_window.h on the CPU: its networks, and the order of the
// fragments of a pixel as cuda/render/blend/pixel_order.cuh drives it.
#include "cuda/render/blend/pixel_window.h"

#include <optional>

#include "gs_render/renderer.h"
#include "gs_render/stages.h"
#include "tests/support/scenes.h"

namespace gs::cuda {
namespace {

WindowKeys random_keys(Draws& draws, float share_of_none) {
  WindowKeys keys;
  for (std::uint32_t& key : keys.of)
    key = draws.chance(share_of_none) ? 0 : window_key(draws.uniform(0.1f, 10), 0);
  return keys;
}

TEST(PixelWindow, MergeLeavesTheSmallerHalfAndHoldsTheLargerOne) {
  Draws draws(1);
  for (int k = 0; k < 300; ++k) {
    WindowKeys held = random_keys(draws, 0.3f), arriving = random_keys(draws, 0.3f);
    std::sort(std::begin(held.of), std::end(held.of));
    std::vector<std::uint32_t> all(std::begin(held.of), std::end(held.of));
    all.insert(all.end(), std::begin(arriving.of), std::end(arriving.of));
    std::sort(all.begin(), all.end());
    merge(held, arriving);
    for (int i = 0; i < kWindow; ++i) {
      EXPECT_EQ(arriving.of[i], all[i]);
      EXPECT_EQ(held.of[i], all[kWindow + i]);
    }
  }
}

TEST(PixelWindow, CountsUpToTheLastKeyOfAQuarter) {
  WindowKeys held{};
  EXPECT_EQ(count_up_to_quarter(held, 0), 0);  // no fragment has the bits of a place
  held.of[13] = window_key(1, kWindow + 3);
  held.of[14] = window_key(2, 5);
  held.of[15] = window_key(3, 3 * kWindow);
  EXPECT_EQ(count_up_to_quarter(held, 0), 15);
  EXPECT_EQ(count_up_to_quarter(held, 1), 14);
  EXPECT_EQ(count_up_to_quarter(held, 2), 0);
  EXPECT_EQ(count_up_to_quarter(held, 3), 16);
}

/// The order in which a pixel blends the fragments of these depths; 0: it has none of that splat.
std::vector<std::size_t> window_order(const std::vector<float>& depths) {
  std::vector<std::size_t> order, listed(kPlaces);
  WindowKeys held{};
  int quarter = 0;
  for (std::size_t first = 0; first < depths.size(); first += kWindow) {
    WindowKeys arriving{};
    for (std::size_t k = 0; k < kWindow && first + k < depths.size(); ++k) {
      const int place = quarter * kWindow + int(k);
      listed[place] = first + k;
      if (depths[first + k] > 0) arriving.of[k] = window_key(depths[first + k], place);
    }
    merge(held, arriving);
    quarter = (quarter + 1) % kQuarters;
    const bool is_done = first + kWindow >= depths.size();
    const int going = is_done ? kWindow : count_up_to_quarter(held, quarter);
    for (const std::uint32_t key : arriving.of)
      if (key) order.push_back(listed[place_of_key(key)]);
    for (int i = 0; i < going; ++i) {
      if (held.of[i]) order.push_back(listed[place_of_key(held.of[i])]);
      held.of[i] = 0;
    }
  }
  return order;
}

TEST(PixelWindow, FindsTheOrderWhereAtMost16FartherOnesCameBefore) {
  Draws draws(2);
  for (int k = 0; k < 50; ++k) {
    std::vector<float> depths;
    for (int i = 0; i < 400; ++i)  // an exchange moves a splat by at most 14 places
      depths.push_back(1 + 0.01f * (float(i) + draws.uniform(-7, 7)));
    for (float& depth : depths)
      if (draws.chance(0.2f)) depth = 0;
    const std::vector<std::size_t> order = window_order(depths);
    EXPECT_EQ(order.size(), depths.size() - std::count(depths.begin(), depths.end(), 0.0f));
    for (std::size_t i = 1; i < order.size(); ++i)
      EXPECT_LE(depths[order[i - 1]], depths[order[i]] * (1 + 2e-5f));  // the last bits of a key
  }
}

TEST(PixelWindow, BlendsEachFragmentOnceWhateverTheirOrder) {
  Draws draws(3);
  for (int k = 0; k < 50; ++k) {
    std::vector<float> depths(1 + draws.below(300));
    for (float& depth : depths) depth = draws.chance(0.5f) ? 0 : draws.uniform(0.1f, 100);
    std::vector<std::size_t> order = window_order(depths), all;
    for (std::size_t i = 0; i < depths.size(); ++i)
      if (depths[i] > 0) all.push_back(i);
    std::sort(order.begin(), order.end());
    EXPECT_EQ(order, all);
  }
}

constexpr int kAcross = 8, kDown = 4;  // pixels of a warp

/// A Gaussian, by a depth.
using Keyed = std::pair<float, std::uint32_t>;
bool is_nearer(const Keyed& a, const Keyed& b) { return a.first < b.first; }

/// Where a splat is largest in a rectangle of pixels, and how deep it is there; behind the eye it is
/// last. None if it does not hit them.
std::optional<Keyed> at_best_point(const RenderPass& pass, std::uint32_t row, int x0, int y0,
                                   int width, int height) {
  const Splat& splat = pass.splats[row];
  const LeastPoint best =
      least_in_rectangle(splat.mean2d, splat.conic, float(x0) + 0.5f, float(x0 + width) - 0.5f,
                         float(y0) + 0.5f, float(y0 + height) - 0.5f);
  if (best.value > splat.cutoff) return {};
  const float depth = pass.ray_depths[row].at(best.offset.x, best.offset.y);
  return Keyed{depth > 0 ? depth : 1e37f, row};
}

/// The Gaussians that hit the pixels of a warp, in the order in which they pass its sort.
std::vector<std::uint32_t> passed_by_warp(const RenderPass& pass, int x0, int y0) {
  const int tile = y0 / kTileHeight * pass.tiles_x + x0 / kTileWidth;
  std::vector<Keyed> in_part, held;
  for (std::uint32_t k = pass.tile_ranges[tile]; k < pass.tile_ranges[tile + 1]; ++k) {
    const std::uint32_t row = pass.tile_splats[k];
    if (!at_best_point(pass, row, x0, y0 / kPart * kPart, kPart, kPart)) continue;
    in_part.push_back(*at_best_point(pass, row, x0 / kTileWidth * kTileWidth,
                                     y0 / kTileHeight * kTileHeight, kTileWidth, kTileHeight));
  }
  std::stable_sort(in_part.begin(), in_part.end(), is_nearer);
  std::vector<std::uint32_t> passed;
  for (std::size_t first = 0; first < in_part.size(); first += 32) {
    for (std::size_t k = first; k < std::min(first + 32, in_part.size()); ++k)
      if (const auto keyed = at_best_point(pass, in_part[k].second, x0, y0, kAcross, kDown))
        held.push_back(*keyed);
    std::stable_sort(held.begin(), held.end(), is_nearer);
    for (; held.size() > 32; held.erase(held.begin())) passed.push_back(held.front().second);
  }
  for (const Keyed& keyed : held) passed.push_back(keyed.second);
  return passed;
}

/// The color of a pixel that goes through a list with a window.
Vec3f color_by_window(const RenderPass& pass, const std::vector<std::uint32_t>& list, int x,
                      int y) {
  std::vector<float> depths, alphas;
  for (const std::uint32_t row : list) {
    const Splat& splat = pass.splats[row];
    const float dx = float(x) + 0.5f - splat.mean2d.x, dy = float(y) + 0.5f - splat.mean2d.y;
    const float exponent = fragment_exponent(splat.conic, dx, dy);
    const float depth = pass.ray_depths[row].at(dx, dy);
    depths.push_back(exponent >= -splat.cutoff && depth > 0 ? depth : 0);
    alphas.push_back(splat.opacity * std::exp(exponent));
  }
  PixelState<float> pixel;
  for (const std::size_t k : window_order(depths)) {
    composite(pixel, pass.splats[list[k]].color, alphas[k]);
    if (is_opaque(pixel.transmittance)) break;
  }
  return pixel.color;
}

TEST(PixelWindow, PicturesAreThoseOfAFullSortInAllButOneOfAThousandPixels) {
  const Camera camera = random_camera(160, 120, 3);
  for (const Recipe& recipe : {kTypical, kSharp, kNegativeColors}) {
    RenderSettings settings;
    settings.order = RenderOrder::pixel;
    RenderPass pass;
    make_scalar_renderer()->forward(random_gaussians(recipe, 2000, camera, 11).span(), camera,
                                    settings, pass);
    std::size_t wrong = 0;
    for (int y0 = 0; y0 < 120; y0 += kDown)
      for (int x0 = 0; x0 < 160; x0 += kAcross) {
        const std::vector<std::uint32_t> list = passed_by_warp(pass, x0, y0);
        for (int k = 0; k < kAcross * kDown; ++k) {
          const int x = x0 + k % kAcross, y = y0 + k / kAcross;
          const Vec3f color = color_by_window(pass, list, x, y);
          float worst = 0;
          for (int c = 0; c < 3; ++c)
            worst = std::max(
                worst,
                std::abs(color[c] - pass.image[c * pass.pixel_count() + std::size_t(y) * 160 + x]));
          wrong += !(worst < 1e-4f);
        }
      }
    EXPECT_LE(wrong, pass.pixel_count() / 1000);
  }
}

}  // namespace
}  // namespace gs::cuda
