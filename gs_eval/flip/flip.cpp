// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/flip/flip.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_eval/flip/flip_color.h"
#include "gs_eval/flip/flip_filters.h"

namespace gs {
namespace {

constexpr double kPixelsPerDegree = 0.7 * (3840 / 0.7) * (std::numbers::pi / 180);
constexpr double kColorExponent = 0.7;  // that of features is 1/2
// Color errors up to this share of the largest are mapped to [0, 0.95], the others to the rest.
constexpr double kKnee = 0.4, kKneeError = 0.95;
constexpr int kMostTaps = 33;           // of a filter
constexpr std::size_t kLeastRows = 16;  // of a band; each also reads 10 rows on both sides

using Row = std::vector<double>;

// What the observer sees of the pixels of one row.
struct SeenRow {
  explicit SeenRow(std::size_t width)
      : lightness(width), a(width), b(width), edge(width), point(width) {}

  Row lightness, a, b;  // filtered colors
  Row edge, point;      // how strongly each pixel lies on an edge or a point
};

// The rows of one picture that the filters across them reach, after the filters along them.
class FilteredRows {
 public:
  /// For output rows from `begin` on.
  FilteredRows(const ImageF& image, const FlipFilters& filters, int begin)
      : image_(image), filters_(filters), width_(std::size_t(image.width)),
        next_(std::max(begin - filters.radius(), 0)), scratch_(width_) {
    for (Row& plane : planes_) plane.resize(std::size_t(kept()) * width_);
    for (Row& channel : channels_) channel.resize(width_ + 2 * std::size_t(filters.radius()));
  }

  /// Of an output row; they are asked for in order.
  void see(int y, SeenRow& seen) {
    for (; next_ <= std::min(y + filters_.radius(), image_.height - 1); ++next_) filter_row(next_);
    across(kAchromatic, filters_.achromatic, y, seen.lightness);
    across(kRedGreen, filters_.red_green, y, seen.a);
    across(kBlueYellow0, filters_.blue_yellow[0], y, seen.b);
    across(kBlueYellow1, filters_.blue_yellow[1], y, scratch_);
    const FlipColors colors;
    double *const lightness = seen.lightness.data(), *const a = seen.a.data(),
                  *const b = seen.b.data(), *const other = scratch_.data();
    const double share = filters_.blue_yellow_share[0], other_share = filters_.blue_yellow_share[1];
    for (std::size_t x = 0; x < width_; ++x) {
      Vec3d rgb =
          colors.linear_from_ycxcz({lightness[x], a[x], share * b[x] + other_share * other[x]});
      rgb = {in_range(rgb.x), in_range(rgb.y), in_range(rgb.z)};
      const Vec3d lab = colors.hunt_lab(rgb);
      lightness[x] = lab.x, a[x] = lab.y, b[x] = lab.z;
    }
    across(kSlope, filters_.feature, y, seen.edge);
    across(kSmooth, filters_.feature_slope, y, scratch_);
    take_length(scratch_, seen.edge);
    across(kCurve, filters_.feature, y, seen.point);
    across(kSmooth, filters_.feature_curve, y, scratch_);
    take_length(scratch_, seen.point);
  }

 private:
  // A channel filtered along the rows; the last three are of lightness, for edges and points.
  enum Plane {
    kAchromatic,
    kRedGreen,
    kBlueYellow0,
    kBlueYellow1,
    kSmooth,
    kSlope,
    kCurve,
    kPlanes
  };

  static double in_range(double value) { return std::min(std::max(value, 0.0), 1.0); }
  // Rows that are kept at a time.
  int kept() const { return 2 * filters_.radius() + 1; }
  double* row(Plane plane, int y) {
    return planes_[plane].data() + std::size_t(y % kept()) * width_;
  }

  void filter_row(int y) {
    const std::size_t border = std::size_t(filters_.radius());
    double* const channels[4] = {channels_[0].data() + border, channels_[1].data() + border,
                                 channels_[2].data() + border, channels_[3].data() + border};
    const float* const pixels = &image_.at(0, y, 0);
    for (std::size_t c = 0; c < 3; ++c)
      for (std::size_t x = 0; x < width_; ++x)
        channels[c][x] = linear_from_srgb(double(pixels[3 * x + c]));
    const FlipColors colors;
    for (std::size_t x = 0; x < width_; ++x) {
      const Vec3d ycxcz =
          colors.ycxcz_from_linear({channels[0][x], channels[1][x], channels[2][x]});
      channels[0][x] = ycxcz.x, channels[1][x] = ycxcz.y, channels[2][x] = ycxcz.z;
      channels[3][x] = (ycxcz.x + 16) * (1.0 / 116);
    }
    for (Row& channel : channels_) repeat_ends(channel, border);
    along(filters_.achromatic, channels[0], kAchromatic, y);
    along(filters_.red_green, channels[1], kRedGreen, y);
    along(filters_.blue_yellow[0], channels[2], kBlueYellow0, y);
    along(filters_.blue_yellow[1], channels[2], kBlueYellow1, y);
    along(filters_.feature, channels[3], kSmooth, y);
    along(filters_.feature_slope, channels[3], kSlope, y);
    along(filters_.feature_curve, channels[3], kCurve, y);
  }

  // Beyond the picture its outermost pixels repeat.
  void repeat_ends(Row& channel, std::size_t border) const {
    const auto first = channel.begin() + std::ptrdiff_t(border),
               end = first + std::ptrdiff_t(width_);
    std::fill(channel.begin(), first, *first);
    std::fill(end, channel.end(), *(end - 1));
  }

  void along(const RowFilter& filter, const double* values, Plane plane, int y) {
    const double* rows[kMostTaps];
    for (int d = -filter.radius(); d <= filter.radius(); ++d)
      rows[d + filter.radius()] = values + d;
    filter_rows(filter, rows, row(plane, y), width_);
  }

  void across(Plane plane, const RowFilter& filter, int y, Row& out) {
    const double* rows[kMostTaps];
    for (int d = -filter.radius(); d <= filter.radius(); ++d)
      rows[d + filter.radius()] = row(plane, std::clamp(y + d, 0, image_.height - 1));
    filter_rows(filter, rows, out.data(), width_);
  }

  static void take_length(const Row& u, Row& v) {
    for (std::size_t x = 0; x < u.size(); ++x) v[x] = std::sqrt(u[x] * u[x] + v[x] * v[x]);
  }

  const ImageF& image_;
  const FlipFilters& filters_;
  std::size_t width_;
  int next_;             // row to filter
  Row planes_[kPlanes];  // (kept(), width) each
  Row channels_[4];      // of one row, with a border; the last one is lightness in [0, 1]
  Row scratch_;
};

// The color error of green against blue, the largest that two colors of a display have.
double largest_color_error() {
  const FlipColors colors;
  return power_of(hyab(colors.hunt_lab({0, 1, 0}), colors.hunt_lab({0, 0, 1})), kColorExponent);
}

// Replaces the lightness of the render by how far its color is from the photo's.
void take_color_errors(SeenRow& render, const SeenRow& photo, double largest) {
  double* const error = render.lightness.data();
  const double *const a = render.a.data(), *const b = render.b.data(),
                      *const photo_L = photo.lightness.data(), *const photo_a = photo.a.data(),
                      *const photo_b = photo.b.data();
  const double knee = kKnee * largest, slope = kKneeError / knee,
               slope_above = (1 - kKneeError) / (largest - knee);
  const std::size_t width = render.lightness.size();
  for (std::size_t x = 0; x < width; ++x) {
    const double distance = power_of(
        hyab({error[x], a[x], b[x]}, {photo_L[x], photo_a[x], photo_b[x]}), kColorExponent);
    // The first line is the steeper one, so that the lower one counts on both sides of the knee.
    error[x] =
        std::min(1.0, std::min(slope * distance, kKneeError + slope_above * (distance - knee)));
  }
}

// Replaces the edges of the render by the larger of both errors of features.
void take_feature_errors(SeenRow& render, const SeenRow& photo) {
  double* const error = render.edge.data();
  const double *const point = render.point.data(), *const photo_edge = photo.edge.data(),
                      *const photo_point = photo.point.data();
  const std::size_t width = render.edge.size();
  for (std::size_t x = 0; x < width; ++x) {
    const double largest =
        std::max(std::abs(error[x] - photo_edge[x]), std::abs(point[x] - photo_point[x]));
    error[x] = std::sqrt(largest * (1 / std::numbers::sqrt2));
  }
}

void set_errors(SeenRow& render, const SeenRow& photo, double largest, float* errors) {
  take_color_errors(render, photo, largest);
  take_feature_errors(render, photo);
  double* const color = render.lightness.data();
  const double* const feature = render.edge.data();
  const std::size_t width = render.edge.size();
  for (std::size_t x = 0; x < width; ++x) color[x] = power_of(color[x], 1 - feature[x]);
  std::copy_n(color, width, errors);
}

}  // namespace

ImageF flip_map(const ImageF& render, const ImageF& photo) {
  GS_CHECK(render.width == photo.width && render.height == photo.height && render.channels == 3 &&
           photo.channels == 3 && !render.empty());
  const FlipFilters filters = flip_filters(kPixelsPerDegree);
  GS_CHECK(2 * filters.radius() < kMostTaps);
  const double largest = largest_color_error();
  ImageF map(render.width, render.height, 1);
  const std::size_t height = std::size_t(map.height), threads = std::size_t(thread_count());
  const std::size_t band = std::max(kLeastRows, (height + threads - 1) / threads);
  parallel_chunks(height, band, [&](std::size_t begin, std::size_t end) {
    FilteredRows render_rows(render, filters, int(begin)), photo_rows(photo, filters, int(begin));
    SeenRow in_render(std::size_t(map.width)), in_photo = in_render;
    for (int y = int(begin); y < int(end); ++y) {
      render_rows.see(y, in_render);
      photo_rows.see(y, in_photo);
      set_errors(in_render, in_photo, largest, &map.at(0, y, 0));
    }
  });
  return map;
}

double flip(const ComparedPictures& pictures) {
  const ImageF map = flip_map(pictures.render, pictures.photo);
  double sum = 0, weights = 0;
  for (int y = 0; y < map.height; ++y)
    for (int x = 0; x < map.width; ++x) {
      sum += pictures.weight_at(x, y) * double(map.at(x, y, 0));
      weights += pictures.weight_at(x, y);
    }
  GS_CHECK(weights > 0);
  return sum / weights;
}

}  // namespace gs
