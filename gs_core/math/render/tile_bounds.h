// SPDX-License-Identifier: Apache-2.0
// Stages 1 and 2: where a splat ends: its cutoff, its bounding rectangle, and the tiles that it
// really hits.
#pragma once

#include <limits>

#include "gs_core/math/constants.h"
#include "gs_core/math/render/render_rules.h"
#include "gs_core/types.h"

namespace gs {

/// The exponent below which a fragment is dropped, negated: alpha = o exp(E) is kept iff E >=
/// -cutoff.
///
///   alpha:   ln(255 o)      opacity-aware bound, Faster-GS
///   sigma n: n^2 / 2
/// Negative for o < 1/255 in mode alpha: such a splat has no fragment.
template <class T>
GS_HD T cutoff_of(Truncation truncation, const T& opacity) {
  using std::log;
  if (truncation == Truncation::sigma2) return T(2);
  if (truncation == Truncation::sigma3) return T(4.5);
  if (truncation == Truncation::sigma4) return T(8);
  return log(opacity / T(kMinAlpha));
}

// Functions that depend on the size of tiles take its edge as a template parameter.
static_assert(kTileWidth == kTileHeight);

/// Half-open rectangle of pixels, or of tiles.
struct Rect {
  std::uint16_t x_begin, x_end, y_begin, y_end;
  GS_HD bool empty() const { return x_begin >= x_end || y_begin >= y_end; }
};

/// The pixels whose centers lie in the splat's axis-aligned bounding box: half extents
/// sqrt(2 cutoff Sigma'_xx) and sqrt(2 cutoff Sigma'_yy) around the mean.
///                                                            Faster-GS, opacity-aware bounds
///
/// mean2d   pixels           cov2d  pixels^2           cutoff  >= 0
/// tiles_x, tiles_y  size of the tile grid, at most 65535 pixels along each axis; the rectangle is
///                   clamped to the grid and not to the picture, so that splats beyond the edge do
///                   not crowd the last tiles
/// Returns an empty rectangle where nothing is hit, an input is NaN or the mean is infinite.
template <int edge = kTileWidth>
GS_HD Rect pixel_rect(const Vec2f& mean2d, const Sym2<float>& cov2d, float cutoff, int tiles_x,
                      int tiles_y) {
  using std::ceil, std::floor, std::sqrt;
  const float ex = sqrt(2.0f * cutoff * cov2d.xx), ey = sqrt(2.0f * cutoff * cov2d.yy);
  // First and last pixel whose center (i + 0.5) lies in the box, as half-open bounds.
  const float x0 = max_of(ceil(mean2d.x - ex - 0.5f), 0.0f);
  const float y0 = max_of(ceil(mean2d.y - ey - 0.5f), 0.0f);
  const float x1 = min_of(floor(mean2d.x + ex - 0.5f) + 1.0f, float(tiles_x * edge));
  const float y1 = min_of(floor(mean2d.y + ey - 0.5f) + 1.0f, float(tiles_y * edge));
  if (!(x0 < x1) || !(y0 < y1)) return {0, 0, 0, 0};
  return {std::uint16_t(x0), std::uint16_t(x1), std::uint16_t(y0), std::uint16_t(y1)};
}

/// The pixels of the tiles that the square of TileBounds::square touches; arguments as above.
template <int edge = kTileWidth>
GS_HD Rect square_rect(const Vec2f& mean2d, const Sym2<float>& cov2d, int tiles_x, int tiles_y) {
  using std::ceil, std::floor, std::sqrt;
  const float mid = 0.5f * (cov2d.xx + cov2d.yy), half = 0.5f * (cov2d.xx - cov2d.yy);
  const float radius = ceil(3.0f * sqrt(mid + sqrt(half * half + cov2d.xy * cov2d.xy)));
  const float size = float(edge);
  const float x0 = max_of(floor((mean2d.x - radius) / size) * size, 0.0f);
  const float y0 = max_of(floor((mean2d.y - radius) / size) * size, 0.0f);
  const float x1 = min_of(ceil((mean2d.x + radius) / size), float(tiles_x)) * size;
  const float y1 = min_of(ceil((mean2d.y + radius) / size), float(tiles_y)) * size;
  if (!(x0 < x1) || !(y0 < y1)) return {0, 0, 0, 0};
  return {std::uint16_t(x0), std::uint16_t(x1), std::uint16_t(y0), std::uint16_t(y1)};
}

/// The rectangle of pixels within which a splat is looked for.
template <int edge = kTileWidth>
GS_HD Rect pixels_of(TileBounds bounds, const Vec2f& mean2d, const Sym2<float>& cov2d, float cutoff,
                     int tiles_x, int tiles_y) {
  return bounds == TileBounds::square ? square_rect<edge>(mean2d, cov2d, tiles_x, tiles_y)
                                      : pixel_rect<edge>(mean2d, cov2d, cutoff, tiles_x, tiles_y);
}
/// The cutoff with which tiles of that rectangle are tested: only TileBounds::exact leaves any out.
GS_HD float tile_cutoff(TileBounds bounds, float cutoff) {
  return bounds == TileBounds::exact ? cutoff : 1e30f;
}

/// The tiles that a rectangle of pixels touches.
template <int edge = kTileWidth>
GS_HD Rect tile_rect(const Rect& pixels) {
  return {std::uint16_t(pixels.x_begin / edge), std::uint16_t((pixels.x_end + edge - 1) / edge),
          std::uint16_t(pixels.y_begin / edge), std::uint16_t((pixels.y_end + edge - 1) / edge)};
}

/// Where the quadratic 1/2 d^T Q d of a splat is least, and how much.
struct LeastPoint {
  Vec2f offset;  // d, from the mean, pixels
  float value;
};
/// The best point of a rectangle of pixel centers, at which a splat's exponent is largest.
///                                                              Radl et al. 2024 (StopThePop)
///
/// x_min .. y_max  the outermost pixel centers   pixels
/// slack           relative rounding error of the quadratic that the value may be lower by; 0: none
///
/// The smallest value over the rectangle lies at the mean if that is inside, else on one of the two
/// edges nearest to it; along an edge the minimum of the parabola is clamped to the edge. Edges
/// that the mean is not outside of are replaced by the column or row through it, so that nothing
/// branches.
GS_HD LeastPoint least_in_rectangle(const Vec2f& mean2d, const Sym2<float>& conic, float x_min,
                                    float x_max, float y_min, float y_max, float slack = 0) {
  using std::fmax, std::fmin;
  const float left = x_min - mean2d.x, right = x_max - mean2d.x;
  const float up = y_min - mean2d.y, down = y_max - mean2d.y;
  // From the mean to the rectangle's nearest column and row; 0 where the mean is between the edges.
  const float fx = fmin(fmax(left, 0.0f), right), fy = fmin(fmax(up, 0.0f), down);
  // The least along that column, and along that row.
  const float x = fmin(fmax(-conic.xy / conic.xx * fy, left), right);
  const float y = fmin(fmax(-conic.xy / conic.yy * fx, up), down);
  const auto quadratic = [&](float dx, float dy) {
    const float square = multiply_add(conic.xx * dx, dx, conic.yy * dy * dy);
    return multiply_add(conic.xy * dx, dy, (0.5f - slack) * square);
  };
  const float in_column = quadratic(fx, y), in_row = quadratic(x, fy);
  if (in_row < in_column) return {{x, fy}, in_row};
  return {{fx, y}, in_column};
}

/// True where some point of the rectangle has an exponent >= -cutoff.
GS_HD bool rectangle_is_hit(const Vec2f& mean2d, const Sym2<float>& conic, float cutoff,
                            float x_min, float x_max, float y_min, float y_max, float slack = 0) {
  return least_in_rectangle(mean2d, conic, x_min, x_max, y_min, y_max, slack).value <= cutoff;
}

/// rectangle_is_hit() for a tile.
GS_HD bool tile_is_hit(const Vec2f& mean2d, const Sym2<float>& conic, float cutoff, int tile_x,
                       int tile_y) {
  const float x = float(tile_x * kTileWidth) + 0.5f, y = float(tile_y * kTileHeight) + 0.5f;
  return rectangle_is_hit(mean2d, conic, cutoff, x, x + float(kTileWidth - 1), y,
                          y + float(kTileHeight - 1));
}

/// Tiles [begin, end) of one row.
struct TileSpan {
  int begin, end;
};

/// What a splat's ellipse 1/2 d^T Q d <= cutoff covers of a band of y, as a range of x, both about
/// its mean; empty where left > right. The ellipse is convex: the range ends where the ellipse
/// itself does, or, if that is outside of the band, on the edge of the band next to it; with |Q| =
/// det:
///
///   x = (-Q_xy y -+ sqrt(2 cutoff Q_xx - det y^2)) / Q_xx     at y = clamp(+-(Q_xy / Q_yy) x_max, band),
///   x_max = sqrt(2 cutoff Q_yy / det)
struct BandRange {
  float left, right;
};
/// Quotients and roots as they are defined; others may be faster.
struct ExactArithmetic {
  GS_HD static float quotient(float a, float b) { return a / b; }
  GS_HD static float root(float x) {
    using std::sqrt;
    return sqrt(x);
  }
};
template <class Arithmetic = ExactArithmetic>
GS_HD BandRange range_in_band(const Sym2<float>& conic, float det, float cutoff, float y_first,
                              float y_last) {
  using A = Arithmetic;
  const float x_max = A::root(A::quotient(2.0f * cutoff * conic.yy, det)),
              y_of_x_max = A::quotient(-conic.xy, conic.yy) * x_max;
  const float y_right = clamp_to(y_of_x_max, y_first, y_last);
  const float y_left = clamp_to(-y_of_x_max, y_first, y_last);
  const float root2_right = multiply_add(-det * y_right, y_right, 2.0f * cutoff * conic.xx);
  const float root2_left = multiply_add(-det * y_left, y_left, 2.0f * cutoff * conic.xx);
  if (!(root2_right >= 0.0f && root2_left >= 0.0f)) return {1.0f, -1.0f};
  return {y_left == -y_of_x_max ? -x_max
                                : A::quotient(-A::root(root2_left) - conic.xy * y_left, conic.xx),
          y_right == y_of_x_max ? x_max
                                : A::quotient(A::root(root2_right) - conic.xy * y_right, conic.xx)};
}
/// |Q|. Of a needle's nothing but rounding may be left.
GS_HD float band_determinant(const Sym2<float>& conic) {
  const float square = conic.xx * conic.yy;
  return max_of(multiply_add(-conic.xy, conic.xy, square), 1e-7f * square);
}

/// The tiles of one row that the splat hits: tile_is_hit() for a whole row at once, solved instead
/// of tested (Speedy-Splat's idea): the hit tiles are those whose columns meet range_in_band().
///
/// tiles   tile_rect() of the splat; the span is within it
/// tile_y  one of its rows
template <int edge = kTileWidth>
GS_HD TileSpan hit_tiles_of_row(const Vec2f& mean2d, const Sym2<float>& conic, float cutoff,
                                const Rect& tiles, int tile_y) {
  using std::ceil, std::floor;
  const float y_first = float(tile_y * edge) + 0.5f - mean2d.y;
  const BandRange x =
      range_in_band(conic, band_determinant(conic), cutoff, y_first, y_first + float(edge - 1));
  if (!(x.left <= x.right)) return {0, 0};
  // A tile's columns of pixel centers are edge x + 0.5 to edge x + edge - 0.5.
  const float begin = ceil((mean2d.x + x.left - (float(edge) - 0.5f)) / float(edge));
  const float end = floor((mean2d.x + x.right - 0.5f) / float(edge)) + 1.0f;
  return {int(clamp_to(begin, float(tiles.x_begin), float(tiles.x_end))),
          int(clamp_to(end, float(tiles.x_begin), float(tiles.x_end)))};
}

inline constexpr int kPart = 8;  // pixels: the edge of a part of a tile
/// Parts along the edge of a tile.
template <int edge>
inline constexpr int kPartsAcross = edge / kPart;

/// The 8 x 8 parts of a row of tiles that a splat hits: columns [begin, end) of each row of parts.
template <int edge>
struct PartSpans {
  static constexpr int kAcross = kPartsAcross<edge>;
  std::int16_t begin[kAcross], end[kAcross];

  /// Those of one tile, as bits, row by row: in a tile of four parts 0 is the upper left one, 1
  /// upper right, 2 lower left, 3 lower right.
  GS_HD unsigned parts_of(int tile_x) const {
    constexpr unsigned kRow = (1u << kAcross) - 1;
    unsigned bits = 0;
    for (int row = 0; row < kAcross; ++row) {
      const int first = max_of(begin[row] - kAcross * tile_x, 0);
      const int count = min_of(end[row] - kAcross * tile_x, kAcross) - first;
      if (count > 0) bits |= ((kRow >> (kAcross - count)) << first) << (row * kAcross);
    }
    return bits;
  }
};
/// They are widened by what rounding may take, so that no fragment is lost that a pixel's own test
/// keeps: the longer a needle is, the less its determinant is known. The longest are granted all
/// columns. Quotients and roots may be off by 1e-6.
template <int edge = kTileWidth, class Arithmetic = ExactArithmetic>
GS_HD PartSpans<edge> hit_parts_of_row(const Vec2f& mean2d, const Sym2<float>& conic, float cutoff,
                                       int tile_y) {
  using std::ceil, std::floor;
  constexpr float kRounding = 4e-7f;  // of the determinant's terms
  constexpr float kUnknown = 0.05f;   // of the determinant
  constexpr float kLeast = 0.02f;     // pixels
  // columns: more than any picture has
  constexpr float kWidth = float(kPart), kEnd = 16384.0f;
  const float det = band_determinant(conic);
  const float error = Arithmetic::quotient(kRounding * conic.xx * conic.yy, det);
  const float y_slack =
      error * Arithmetic::root(Arithmetic::quotient(2.0f * cutoff * conic.xx, det)) + kLeast;
  PartSpans<edge> spans;
  for (int row = 0; row < spans.kAcross; ++row) {
    spans.begin[row] = 0;
    spans.end[row] = std::int16_t(kEnd);
  }
  if (!(error < kUnknown)) return spans;
  for (int row = 0; row < spans.kAcross; ++row) {
    const float y_first = float(tile_y * edge + row * kPart) + 0.5f - mean2d.y;
    const BandRange x = range_in_band<Arithmetic>(conic, det, cutoff, y_first - y_slack,
                                                  y_first + float(kPart - 1) + y_slack);
    const float slack = error * (x.right - x.left) + kLeast;
    const float begin = ceil((mean2d.x + x.left - slack - (kWidth - 0.5f)) * (1.0f / kWidth));
    const float end = floor((mean2d.x + x.right + slack - 0.5f) * (1.0f / kWidth)) + 1.0f;
    const bool is_empty = !(x.left <= x.right);
    spans.begin[row] = std::int16_t(clamp_to(begin, 0.0f, kEnd));
    spans.end[row] = is_empty ? std::int16_t(0) : std::int16_t(clamp_to(end, 0.0f, kEnd));
  }
  return spans;
}

/// Calls visit(tile_x, tile_y) for each tile that the splat hits, row by row. Counting and emitting
/// instances both go through here, so that they cannot disagree.
template <class Visit>
GS_HD void for_each_hit_tile(const Vec2f& mean2d, const Sym2<float>& conic, float cutoff,
                             const Rect& pixels, Visit&& visit) {
  const Rect tiles = tile_rect(pixels);
  for (int y = tiles.y_begin; y < tiles.y_end; ++y) {
    const TileSpan span = hit_tiles_of_row(mean2d, conic, cutoff, tiles, y);
    for (int x = span.begin; x < span.end; ++x) visit(x, y);
  }
}

}  // namespace gs
