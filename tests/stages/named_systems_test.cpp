// SPDX-License-Identifier: Apache-2.0
// What docs/guide/systems.md says of renderers: that the lists of tiles and the exponents here are
// those of FlashGS, Speedy-Splat and TC-GS. Their rules are written again, in double precision and
// by another way than in gs_core.
#include <cmath>
#include <set>

#include "gs_core/math/render/blend.h"
#include "gs_render/renderer.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

constexpr int kWidth = 150, kHeight = 110;  // pixels

/// A splat and the tiles that a rule gives it, by number.
using Tiles = std::set<int>;

/// The value 1/2 d^T Q d of a splat, in double precision.
struct Ellipse {
  double x, y, xx, xy, yy, cutoff;

  explicit Ellipse(const Splat& splat)
      : x(splat.mean2d.x), y(splat.mean2d.y), xx(splat.conic.xx), xy(splat.conic.xy),
        yy(splat.conic.yy), cutoff(splat.cutoff) {}
  double at(double px, double py) const {
    const double dx = px - x, dy = py - y;
    return 0.5 * (xx * dx * dx + yy * dy * dy) + xy * dx * dy;
  }
  double determinant() const { return xx * yy - xy * xy; }
  double half_width() const { return std::sqrt(2 * cutoff * yy / determinant()); }
  double half_height() const { return std::sqrt(2 * cutoff * xx / determinant()); }
  /// Where the line through a point along a direction is inside: begin > end where it is not.
  std::pair<double, double> on_line(double px, double py, double ux, double uy) const {
    const double dx = px - x, dy = py - y;
    const double a = 0.5 * (xx * ux * ux + yy * uy * uy) + xy * ux * uy;
    const double b = xx * dx * ux + yy * dy * uy + xy * (dx * uy + dy * ux);
    const double root = b * b - 4 * a * (at(px, py) - cutoff);
    if (root < 0) return {1, 0};
    return {(-b - std::sqrt(root)) / (2 * a), (-b + std::sqrt(root)) / (2 * a)};
  }
};

/// The outermost pixel centers of a tile.
struct TileRectangle {
  double left, right, up, down;

  TileRectangle(int tile_x, int tile_y)
      : left(tile_x * kTileWidth + 0.5), right(left + kTileWidth - 1),
        up(tile_y * kTileHeight + 0.5), down(up + kTileHeight - 1) {}
};

/// FlashGS (Feng et al. 2024): the mean lies in the tile, or a side of the tile meets the ellipse.
bool is_hit_by_flashgs(const Ellipse& ellipse, const TileRectangle& tile) {
  if (ellipse.x >= tile.left && ellipse.x <= tile.right && ellipse.y >= tile.up &&
      ellipse.y <= tile.down)
    return true;
  const auto meets = [](std::pair<double, double> inside, double length) {
    return inside.first <= inside.second && inside.first <= length && inside.second >= 0;
  };
  const double width = tile.right - tile.left, height = tile.down - tile.up;
  return meets(ellipse.on_line(tile.left, tile.up, 1, 0), width) ||
         meets(ellipse.on_line(tile.left, tile.down, 1, 0), width) ||
         meets(ellipse.on_line(tile.left, tile.up, 0, 1), height) ||
         meets(ellipse.on_line(tile.right, tile.up, 0, 1), height);
}

/// Speedy-Splat (Hanson et al. 2025), AccuTile: the tiles of a row between the least and the largest
/// x that the ellipse has there.
bool is_hit_by_speedy(const Ellipse& ellipse, const TileRectangle& tile) {
  if (ellipse.y + ellipse.half_height() < tile.up || ellipse.y - ellipse.half_height() > tile.down)
    return false;
  double least = 1e30, most = -1e30;
  const auto add = [&](double x) { least = std::min(least, x), most = std::max(most, x); };
  for (const double y : {tile.up, tile.down}) {
    const auto [begin, end] = ellipse.on_line(0, y, 1, 0);
    if (begin <= end) add(begin), add(end);
  }
  for (const double side : {-1.0, 1.0}) {  // the ellipse's own ends, where they are in the row
    const double x = side * ellipse.half_width(), y = ellipse.y - ellipse.xy / ellipse.yy * x;
    if (y >= tile.up && y <= tile.down) add(ellipse.x + x);
  }
  return least <= tile.right && most >= tile.left;
}

/// SnugBox: the tiles of the box about the ellipse.
bool is_in_snug_box(const Ellipse& ellipse, const TileRectangle& tile) {
  return ellipse.x + ellipse.half_width() >= tile.left &&
         ellipse.x - ellipse.half_width() <= tile.right &&
         ellipse.y + ellipse.half_height() >= tile.up &&
         ellipse.y - ellipse.half_height() <= tile.down;
}

class NamedSystems : public testing::Test {
 protected:
  RenderPass render(const Recipe& recipe, TileBounds bounds) {
    RenderSettings settings;
    settings.bounds = bounds;
    RenderPass pass;
    make_scalar_renderer()->forward(random_gaussians(recipe, 1000, camera_, 5).span(), camera_,
                                    settings, pass);
    return pass;
  }
  /// Compares the lists of a picture with a rule. A tile counts as equal where a change of the
  /// cutoff by a millionth changes what the rule says.
  template <class Rule>
  static void expect_lists(const RenderPass& pass, const Rule& is_hit) {
    std::vector<Tiles> tiles_of(pass.splats.size());
    for (int tile = 0; tile < int(pass.tile_count()); ++tile)
      for (std::uint32_t k = pass.tile_ranges[tile]; k < pass.tile_ranges[tile + 1]; ++k)
        tiles_of[pass.tile_splats[k]].insert(tile);
    std::size_t listed = 0, unlike = 0;
    for (std::size_t row = 0; row < tiles_of.size(); ++row) {
      if (tiles_of[row].empty()) continue;
      Ellipse smaller(pass.splats[row]), larger = smaller;
      smaller.cutoff *= 1 - 1e-6, larger.cutoff *= 1 + 1e-6;
      for (int tile = 0; tile < int(pass.tile_count()); ++tile) {
        const TileRectangle rectangle(tile % pass.tiles_x, tile / pass.tiles_x);
        const bool is_listed = tiles_of[row].count(tile) > 0;
        listed += is_listed;
        unlike += is_listed ? !is_hit(larger, rectangle) : is_hit(smaller, rectangle);
      }
    }
    EXPECT_GT(listed, 500u);
    EXPECT_EQ(unlike, 0u);
  }

  const Camera camera_ = random_camera(kWidth, kHeight, 4);
};

TEST_F(NamedSystems, ListsAreThoseOfFlashGs) {
  for (const Recipe& recipe : {kTypical, kSharp, kHuge})
    expect_lists(render(recipe, TileBounds::exact), is_hit_by_flashgs);
}

TEST_F(NamedSystems, ListsAreThoseOfSpeedySplat) {
  for (const Recipe& recipe : {kTypical, kSharp, kHuge}) {
    expect_lists(render(recipe, TileBounds::exact), is_hit_by_speedy);
    expect_lists(render(recipe, TileBounds::box), is_in_snug_box);
  }
}

// TC-GS (Liao et al. 2025) and GEMM-GS: the logarithm of alpha is the product of six numbers of the
// splat and six of the pixel, both from the middle of the tile.
TEST_F(NamedSystems, ExponentsAreTheProductOfTcGs) {
  const RenderPass pass = render(kTypical, TileBounds::exact);
  double worst = 0;
  std::size_t fragments = 0;
  for (int tile = 0; tile < int(pass.tile_count()); ++tile)
    for (std::uint32_t k = pass.tile_ranges[tile]; k < pass.tile_ranges[tile + 1]; ++k) {
      const Splat& splat = pass.splats[pass.tile_splats[k]];
      const Ellipse ellipse(splat);
      const TileRectangle rectangle(tile % pass.tiles_x, tile / pass.tiles_x);
      const float middle_x = float(rectangle.left + 7.5), middle_y = float(rectangle.up + 7.5);
      const ExponentTerms<float> of_splat = exponent_coefficients(
          conic_factors(splat.conic, splat.variance_y),
          {splat.mean2d.x - middle_x, splat.mean2d.y - middle_y}, std::log2(splat.opacity));
      for (int pixel = 0; pixel < kTileWidth * kTileHeight; ++pixel) {
        const float x = float(pixel % kTileWidth) - 7.5f, y = float(pixel / kTileWidth) - 7.5f;
        const double value = ellipse.at(double(middle_x) + x, double(middle_y) + y);
        if (value > ellipse.cutoff) continue;
        ++fragments;
        const double alpha = double(splat.opacity) * std::exp(-value);
        worst = std::max(
            worst, std::abs(std::exp2(double(inner(of_splat, pixel_monomials(x, y)))) - alpha));
      }
    }
  EXPECT_GT(fragments, 10000u);
  EXPECT_LT(worst, 1e-4);
}

}  // namespace
}  // namespace gs
