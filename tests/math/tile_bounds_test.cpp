// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/render/tile_bounds.h"

#include "gs_core/math/render/projection.h"
#include "tests/support/test.h"

namespace gs {
namespace {

constexpr int kTilesX = 20, kTilesY = 12;
constexpr int kPaddedWidth = kTilesX * kTileWidth, kPaddedHeight = kTilesY * kTileHeight;

/// {x_begin, x_end, y_begin, y_end}
std::array<int, 4> bounds(const Rect& rect) {
  return {rect.x_begin, rect.x_end, rect.y_begin, rect.y_end};
}
using Bounds = std::array<int, 4>;

/// One splat with a cutoff.
struct ProjectedSplat {
  Vec2f mean2d;
  Sym2<float> cov2d, conic;
  float cutoff;
};

class SplatRandom {
 public:
  explicit SplatRandom(double largest_sigma) : largest_sigma_(largest_sigma) {}
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine_);
  }
  /// A mean in the padded picture or up to `margin` pixels beyond it; every fourth lies exactly on
  /// a pixel center or a pixel's edge.
  ProjectedSplat splat(double margin) {
    const double a = variance(), b = variance();
    const double angle = uniform(0.0, 3.2), c = std::cos(angle), s = std::sin(angle);
    const Sym2<double> S{a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c};
    const Sym2<double> Q = conic_of(S);
    Vec2f mean{float(uniform(-margin, kPaddedWidth + margin)),
               float(uniform(-margin, kPaddedHeight + margin))};
    if (uniform(0.0, 1.0) < 0.25) {
      mean = {std::round(2.0f * mean.x) / 2.0f, std::round(2.0f * mean.y) / 2.0f};
    }
    return {mean,
            {float(S.xx), float(S.xy), float(S.yy)},
            {float(Q.xx), float(Q.xy), float(Q.yy)},
            float(uniform(0.01, 5.54))};
  }

 private:
  /// Log-uniform, with the blur that every splat has.
  double variance() {
    const double sigma = std::pow(10.0, uniform(-2.0, std::log10(largest_sigma_)));
    return sigma * sigma + 0.3;
  }
  std::mt19937_64 engine_{1};
  double largest_sigma_;
};

// ---- Tile bounds.

// The square of a splat with standard deviations 4 and 2, turned by 45 degrees: 12 pixels around
// the mean, in whole tiles.
TEST(TileBounds, ASquareReachesThreeDeviationsOfTheLongerAxis) {
  const Sym2<float> cov2d{10, 6, 10};
  const Rect rect = pixels_of(TileBounds::square, {50, 40}, cov2d, 0.1f, 20, 20);
  EXPECT_EQ(rect.x_begin, 32);  // 38
  EXPECT_EQ(rect.x_end, 64);    // 62
  EXPECT_EQ(rect.y_begin, 16);  // 28
  EXPECT_EQ(rect.y_end, 64);    // 52
  EXPECT_TRUE(pixels_of(TileBounds::square, {-13, 40}, cov2d, 0.1f, 20, 20).empty());
}

TEST(TileBounds, OnlyExactOnesLeaveOutTilesOfTheBox) {
  const Vec2f mean2d{80, 80};
  const Sym2<float> cov2d{900, -890, 900};  // a needle along a diagonal
  const Sym2<float> conic = conic_of(cov2d);
  const Rect box = pixels_of(TileBounds::box, mean2d, cov2d, 2.0f, 10, 10);
  const auto count = [&](TileBounds bounds) {
    int tiles = 0;
    for_each_hit_tile(mean2d, conic, tile_cutoff(bounds, 2.0f), box, [&](int, int) { ++tiles; });
    return tiles;
  };
  const Rect tiles = tile_rect(box);
  EXPECT_EQ(count(TileBounds::box), (tiles.x_end - tiles.x_begin) * (tiles.y_end - tiles.y_begin));
  EXPECT_LT(count(TileBounds::exact), count(TileBounds::box) / 2);
}

// ---- Cutoffs.

TEST(Cutoff, InAlphaModeIsTheLogarithmOf255Opacities) {
  EXPECT_NEAR(cutoff_of(Truncation::alpha, 1.0f), 5.5412635f, 1e-6f);  // ln 255
  EXPECT_NEAR(cutoff_of(Truncation::alpha, 0.1f), 3.2386784f, 1e-6f);  // ln 25.5
}

TEST(Cutoff, InAlphaModeChangesSignAtOne255th) {
  const float limit = 1.0f / 255.0f;
  EXPECT_EQ(cutoff_of(Truncation::alpha, limit), 0.0f);
  EXPECT_LT(cutoff_of(Truncation::alpha, std::nextafter(limit, 0.0f)), 0.0f);
  EXPECT_GT(cutoff_of(Truncation::alpha, std::nextafter(limit, 1.0f)), 0.0f);
}

TEST(Cutoff, InSigmaModesIsHalfTheSquareWhateverTheOpacity) {
  for (const float opacity : {1e-3f, 0.5f, 1.0f}) {
    EXPECT_EQ(cutoff_of(Truncation::sigma2, opacity), 2.0f);
    EXPECT_EQ(cutoff_of(Truncation::sigma3, opacity), 4.5f);
    EXPECT_EQ(cutoff_of(Truncation::sigma4, opacity), 8.0f);
  }
}

// ---- Rectangles.

Rect pixel_rect_of(const ProjectedSplat& s) {
  return pixel_rect(s.mean2d, s.cov2d, s.cutoff, kTilesX, kTilesY);
}
/// The pixels of a box that reaches `extent` pixels around (x, x): a cutoff of 1/2 is one standard
/// deviation.
Rect rect_of_box(float x, float extent) {
  return pixel_rect({x, x}, {extent * extent, 0.0f, extent * extent}, 0.5f, kTilesX, kTilesY);
}

TEST(PixelRect, HoldsThePixelsWhoseCentersLieOnTheBoxEdges) {
  EXPECT_EQ(bounds(rect_of_box(16.0f, 0.5f)), (Bounds{15, 17, 15, 17}));  // 15.5 to 16.5
  EXPECT_EQ(bounds(rect_of_box(8.0f, 7.5f)), (Bounds{0, 16, 0, 16}));     // 0.5 to 15.5
  EXPECT_EQ(bounds(rect_of_box(24.0f, 7.5f)), (Bounds{16, 32, 16, 32}));  // 16.5 to 31.5
}

TEST(PixelRect, IsEmptyBetweenPixelCenters) {
  EXPECT_TRUE(rect_of_box(16.0f, 0.49f).empty());
  EXPECT_EQ(bounds(rect_of_box(16.5f, 0.01f)), (Bounds{16, 17, 16, 17}));
}

TEST(PixelRect, IsEmptyForANegativeCutoff) {
  for (const float cutoff : {-1e-6f, -std::numeric_limits<float>::infinity()}) {
    EXPECT_TRUE(pixel_rect({50.0f, 50.0f}, {1e4f, 0.0f, 1e4f}, cutoff, kTilesX, kTilesY).empty());
  }
}

/// Pixels [begin, end) with their center in [low, high], and whether one is so close to an edge
/// that floats may decide otherwise: pixel coordinates of up to 1000 have steps of 6e-5.
struct PixelRange {
  int begin, end;
  bool is_close;
};
PixelRange pixels_between(double low, double high, int size) {
  PixelRange range{size, 0, false};
  for (int pixel = 0; pixel < size; ++pixel) {
    const double center = pixel + 0.5;
    range.is_close |= std::abs(center - low) < 1e-3 || std::abs(center - high) < 1e-3;
    if (center < low || center > high) continue;
    range.begin = std::min(range.begin, pixel);
    range.end = std::max(range.end, pixel + 1);
  }
  return range;
}

TEST(PixelRect, IsExactlyThePixelsWithTheirCenterInTheBox) {
  SplatRandom random(100.0);
  int compared = 0, empty = 0;
  for (int i = 0; i < 20'000; ++i) {
    const ProjectedSplat s = random.splat(50.0);
    const double ex = std::sqrt(2.0 * s.cutoff * s.cov2d.xx);
    const double ey = std::sqrt(2.0 * s.cutoff * s.cov2d.yy);
    const PixelRange x = pixels_between(s.mean2d.x - ex, s.mean2d.x + ex, kPaddedWidth);
    const PixelRange y = pixels_between(s.mean2d.y - ey, s.mean2d.y + ey, kPaddedHeight);
    if (x.is_close || y.is_close) continue;
    ++compared;
    if (x.begin >= x.end || y.begin >= y.end) {
      ++empty;
      EXPECT_TRUE(pixel_rect_of(s).empty());
    } else {
      EXPECT_EQ(bounds(pixel_rect_of(s)), (Bounds{x.begin, x.end, y.begin, y.end}));
    }
  }
  EXPECT_GT(compared, 15'000);
  EXPECT_GT(empty, 1'000);
}

constexpr float kNoEnd = std::numeric_limits<float>::infinity();

/// Calls visit(mean2d, cov2d, cutoff) with every combination of valid and invalid numbers.
template <class Visit>
void sweep_bad_numbers(const Visit& visit) {
  const std::vector<float> numbers = {kNan,   kNoEnd, -kNoEnd, 3e38f, -3e38f, 1e20f,
                                      -1e10f, 3e9f,   1e-40f,  0.0f,  -0.5f,  100.0f};
  for (const float x : numbers)
    for (const float y : numbers)
      for (const float xx : numbers)
        for (const float yy : numbers)
          for (const float cutoff : numbers) visit(Vec2f{x, y}, Sym2<float>{xx, 0.0f, yy}, cutoff);
}

TEST(PixelRect, OfAnyNumbersIsInsideTheGridAndEmptyWhereOneIsNotANumberOrTheMeanIsInfinite) {
  int outside = 0, filled = 0, bad = 0;
  sweep_bad_numbers([&](const Vec2f& mean2d, const Sym2<float>& cov2d, float cutoff) {
    const Rect r = pixel_rect(mean2d, cov2d, cutoff, kTilesX, kTilesY);
    outside += r.x_begin > r.x_end || r.x_end > kPaddedWidth || r.y_begin > r.y_end ||
               r.y_end > kPaddedHeight;
    if (!std::isnan(cov2d.xx + cov2d.yy + cutoff) && std::isfinite(mean2d.x) &&
        std::isfinite(mean2d.y))
      return;
    ++bad;
    filled += !r.empty();
  });
  EXPECT_EQ(outside, 0);
  EXPECT_EQ(filled, 0);
  EXPECT_GT(bad, 1'000);
}

TEST(PixelRect, IsTheWholeGridForAnEndlessSplat) {
  for (const float variance : {3e38f, kNoEnd}) {
    EXPECT_EQ(bounds(pixel_rect({5.0f, 5.0f}, {variance, 0.0f, variance}, 5.0f, kTilesX, kTilesY)),
              (Bounds{0, kPaddedWidth, 0, kPaddedHeight}));
  }
}

TEST(TileRect, IsTheTilesOfItsPixelsHalfOpen) {
  EXPECT_EQ(bounds(tile_rect({0, 16, 0, 16})), (Bounds{0, 1, 0, 1}));
  EXPECT_EQ(bounds(tile_rect({15, 17, 16, 32})), (Bounds{0, 2, 1, 2}));
  EXPECT_EQ(bounds(tile_rect({31, 33, 47, 48})), (Bounds{1, 3, 2, 3}));
}

TEST(TileRect, OfNoPixelsIsEmpty) { EXPECT_TRUE(tile_rect({0, 0, 0, 0}).empty()); }

// ---- The exact tile test.

/// The smallest 1/2 d^T Q d over a rectangle of pixel centers: 0 if the mean is inside, else the
/// smallest of the minima of four parabolas, one along each edge.
double smallest_over(const ProjectedSplat& s, int x_begin, int y_begin, int width, int height) {
  const double x0 = x_begin + 0.5 - s.mean2d.x, x1 = x0 + width - 1;
  const double y0 = y_begin + 0.5 - s.mean2d.y, y1 = y0 + height - 1;
  if (x0 <= 0.0 && x1 >= 0.0 && y0 <= 0.0 && y1 >= 0.0) return 0.0;
  const double xx = s.conic.xx, xy = s.conic.xy, yy = s.conic.yy;
  const auto value = [&](double x, double y) {
    return 0.5 * (xx * x * x + yy * y * y) + xy * x * y;
  };
  double smallest = std::numeric_limits<double>::infinity();
  for (const double x : {x0, x1}) {
    smallest = std::min(smallest, value(x, std::clamp(-xy * x / yy, y0, y1)));
  }
  for (const double y : {y0, y1}) {
    smallest = std::min(smallest, value(std::clamp(-xy * y / xx, x0, x1), y));
  }
  return smallest;
}

double smallest_over_tile(const ProjectedSplat& s, int tile_x, int tile_y) {
  return smallest_over(s, tile_x * kTileWidth, tile_y * kTileHeight, kTileWidth, kTileHeight);
}

/// True if a pixel center of the tile has an exponent above the cutoff.
bool holds_a_pixel(const ProjectedSplat& s, int tile_x, int tile_y) {
  for (int y = tile_y * kTileHeight; y < (tile_y + 1) * kTileHeight; ++y) {
    for (int x = tile_x * kTileWidth; x < (tile_x + 1) * kTileWidth; ++x) {
      const double dx = x + 0.5 - s.mean2d.x, dy = y + 0.5 - s.mean2d.y;
      const double half =
          0.5 * (s.conic.xx * dx * dx + s.conic.yy * dy * dy) + s.conic.xy * dx * dy;
      if (half <= s.cutoff * (1.0 - 1e-4)) return true;
    }
  }
  return false;
}

/// A tile near the splat.
template <int edge = kTileWidth>
std::pair<int, int> draw_tile(SplatRandom& random, const ProjectedSplat& s) {
  const double reach_x = 3.0 * std::sqrt(s.cov2d.xx) + edge;
  const double reach_y = 3.0 * std::sqrt(s.cov2d.yy) + edge;
  return {int(std::floor((s.mean2d.x + random.uniform(-reach_x, reach_x)) / edge)),
          int(std::floor((s.mean2d.y + random.uniform(-reach_y, reach_y)) / edge))};
}

// Includes needles of 100 by 0.55 pixels. The float quadratic form of longer ones cancels more than
// four digits.
TEST(TileIsHit, AgreesWithAMinimiserOverTheTile) {
  SplatRandom random(100.0);
  int hits = 0, misses = 0, wrong = 0;
  for (int i = 0; i < 200'000; ++i) {
    const ProjectedSplat s = random.splat(50.0);
    const auto [x, y] = draw_tile(random, s);
    const double smallest = smallest_over_tile(s, x, y);
    const bool is_hit = tile_is_hit(s.mean2d, s.conic, s.cutoff, x, y);
    (is_hit ? hits : misses) += 1;
    wrong += is_hit != (smallest <= s.cutoff) && std::abs(smallest - s.cutoff) > 1e-4 * s.cutoff;
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(hits, 20'000);
  EXPECT_GT(misses, 20'000);
}

// The cutoff lies just above and just below the smallest value, for splats of up to 10 by 0.55
// pixels, whose quadratic form keeps four digits in float.
TEST(TileIsHit, TurnsAtTheSmallestValueOverTheTile) {
  SplatRandom random(10.0);
  int tested = 0, wrong = 0;
  for (int i = 0; i < 200'000; ++i) {
    const ProjectedSplat s = random.splat(50.0);
    const auto [x, y] = draw_tile(random, s);
    const double smallest = smallest_over_tile(s, x, y);
    if (smallest < 0.01 || smallest > 10.0) continue;
    ++tested;
    wrong += !tile_is_hit(s.mean2d, s.conic, float(smallest * (1.0 + 1e-4)), x, y);
    wrong += tile_is_hit(s.mean2d, s.conic, float(smallest * (1.0 - 1e-4)), x, y);
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(tested, 20'000);
}

TEST(TileIsHit, HoldsForAMeanExactlyOnAnyPixelCenterOfTheTile) {
  const Sym2<float> needle = {3.0f, 2.9f, 3.0f};
  for (int y = 0; y < kTileHeight; ++y) {
    for (int x = 0; x < kTileWidth; ++x) {
      const Vec2f mean{float(2 * kTileWidth + x) + 0.5f, float(3 * kTileHeight + y) + 0.5f};
      EXPECT_TRUE(tile_is_hit(mean, needle, 0.0f, 2, 3)) << x << " " << y;
    }
  }
}

// A tiny splat between the last pixel center of a tile and the first of the next one hits neither.
TEST(TileIsHit, IsFalseForASplatBetweenTheCentersOfTwoTiles) {
  const Sym2<float> tiny{100.0f, 0.0f, 100.0f};
  EXPECT_FALSE(tile_is_hit({16.0f, 8.5f}, tiny, 1.0f, 0, 0));
  EXPECT_FALSE(tile_is_hit({16.0f, 8.5f}, tiny, 1.0f, 1, 0));
}

TEST(HitTiles, LoseNoPixelOfTheSplatAndAddNoTileBesideIt) {
  SplatRandom random(30.0);
  int hits = 0, wrong = 0;
  for (int i = 0; i < 10'000; ++i) {
    const ProjectedSplat s = random.splat(50.0);
    std::vector<bool> is_hit(kTilesX * kTilesY);
    for_each_hit_tile(s.mean2d, s.conic, s.cutoff, pixel_rect_of(s),
                      [&](int x, int y) { is_hit[y * kTilesX + x] = true; });
    for (int tile = 0; tile < kTilesX * kTilesY; ++tile) {
      const double smallest = smallest_over_tile(s, tile % kTilesX, tile / kTilesX);
      hits += is_hit[tile];
      if (is_hit[tile]) {
        wrong += smallest > s.cutoff * (1.0 + 1e-4);
      } else {
        // Outside the pixel rectangle, a tile may hold a point of the ellipse between pixel
        // centers.
        wrong +=
            smallest < s.cutoff * (1.0 - 1e-4) && holds_a_pixel(s, tile % kTilesX, tile / kTilesX);
      }
    }
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(hits, 10'000);
}

// The solved span of a row, compared with the minimizer over each of its tiles; includes needles of
// 100 by 0.55 pixels.
TEST(HitTilesOfRow, AreThoseThatAMinimiserFinds) {
  SplatRandom random(100.0);
  const Rect grid{0, kTilesX, 0, kTilesY};
  int hits = 0, misses = 0, wrong = 0;
  for (int i = 0; i < 50'000; ++i) {
    const ProjectedSplat s = random.splat(50.0);
    const int y = int(random.uniform(0.0, kTilesY));
    const TileSpan span = hit_tiles_of_row(s.mean2d, s.conic, s.cutoff, grid, y);
    for (int x = 0; x < kTilesX; ++x) {
      const double smallest = smallest_over_tile(s, x, y);
      const bool is_hit = x >= span.begin && x < span.end;
      (is_hit ? hits : misses) += 1;
      wrong += is_hit != (smallest <= s.cutoff) && std::abs(smallest - s.cutoff) > 1e-3 * s.cutoff;
    }
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(hits, 20'000);
  EXPECT_GT(misses, 20'000);
}

TEST(HitTilesOfRow, HoldTheTileOfAMeanOnAPixelCenterAtCutoffZero) {
  const Sym2<float> needle = {3.0f, 2.9f, 3.0f};
  for (int x = 0; x < kTileWidth; ++x) {
    const Vec2f mean{float(2 * kTileWidth + x) + 0.5f, float(3 * kTileHeight) + 0.5f};
    const TileSpan span = hit_tiles_of_row(mean, needle, 0.0f, {0, 5, 0, 5}, 3);
    EXPECT_EQ(std::make_pair(span.begin, span.end), std::make_pair(2, 3)) << x;
  }
}

// Includes needles of 1000 by 0.55 pixels. Their float conics describe a slightly different
// ellipse, but no fragment of a part may be lost. Few parts may be listed in vain.
template <int edge>
void expect_parts() {
  for (const double sigma : {3.0, 30.0, 1000.0}) {
    SplatRandom random(sigma);
    int hits = 0, lost = 0, spare = 0;
    for (int i = 0; i < 20'000; ++i) {
      const ProjectedSplat s = random.splat(50.0);
      const auto [tile_x, tile_y] = draw_tile<edge>(random, s);
      if (tile_x < 0 || tile_y < 0) continue;
      const unsigned bits =
          hit_parts_of_row<edge>(s.mean2d, s.conic, s.cutoff, tile_y).parts_of(tile_x);
      constexpr int kAcross = kPartsAcross<edge>;
      EXPECT_EQ(bits >> (kAcross * kAcross), 0u);
      for (int part = 0; part < kAcross * kAcross; ++part) {
        const bool is_hit =
            smallest_over(s, tile_x * edge + part % kAcross * kPart,
                          tile_y * edge + part / kAcross * kPart, kPart, kPart) <= s.cutoff;
        hits += is_hit;
        lost += is_hit && !(bits >> part & 1);
        spare += !is_hit && (bits >> part & 1);
      }
    }
    EXPECT_EQ(lost, 0) << sigma;
    EXPECT_GT(hits, 4'000) << sigma;
    EXPECT_LT(spare, (sigma < 100 ? 0.03 : 0.3) * hits) << sigma;
  }
}
TEST(HitPartsOfRow, HoldAllFragmentsAndLittleElse) {
  expect_parts<kTileWidth>();
  expect_parts<kWideTile>();
}

TEST(PartSpans, HaveABitForEachPartOfATile) {
  const PartSpans<kTileWidth> four{{1, 2}, {3, 2}};  // columns 1 and 2 above, none below
  EXPECT_EQ(four.parts_of(0), 0b0010u);
  EXPECT_EQ(four.parts_of(1), 0b0001u);
  EXPECT_EQ(four.parts_of(2), 0u);
  const PartSpans<kWideTile> nine{{0, 2, 4}, {9, 4, 5}};
  EXPECT_EQ(nine.parts_of(0), 0b000'100'111u);
  EXPECT_EQ(nine.parts_of(1), 0b010'001'111u);
  EXPECT_EQ(nine.parts_of(2), 0b000'000'111u);
}

TEST(HitTiles, AreVisitedRowByRow) {
  std::vector<std::pair<int, int>> visited;
  for_each_hit_tile({16.0f, 16.0f}, {0.01f, 0.0f, 0.01f}, 2.0f, {10, 22, 10, 22},
                    [&](int x, int y) { visited.emplace_back(x, y); });
  EXPECT_EQ(visited, (std::vector<std::pair<int, int>>{{0, 0}, {1, 0}, {0, 1}, {1, 1}}));
}

}  // namespace
}  // namespace gs
