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
constexpr double kColorExponent = 0.7, kFeatureExponent = 0.5;
// Color errors up to this share of the largest are mapped to [0, 0.95], the others to the rest.
constexpr double kKnee = 0.4, kKneeError = 0.95;
constexpr std::size_t kRowsPerThread = 64;  // of output; each band also reads 10 rows on both sides

using Row = std::vector<double>;

// What the observer sees of the pixels of one row.
struct SeenRow {
  Row lightness, a, b;  // filtered colors
  Row edge, point;      // how strongly each pixel lies on an edge or a point
};

// Some rows of one picture after the filters along the rows.
class Band {
 public:
  /// For the output rows [begin, end): with the rows that the filters reach on both sides.
  Band(const ImageF& image, const FlipFilters& filters, int begin, int end)
      : image_(image), filters_(filters), width_(std::size_t(image.width)),
        first_(std::max(begin - filters.radius(), 0)),
        last_(std::min(end + filters.radius(), image.height) - 1) {
    for (std::vector<Row>& plane : planes_)
      plane.assign(std::size_t(last_ - first_ + 1), Row(width_));
    for (int y = first_; y <= last_; ++y) filter_row(y);
  }

  /// Of an output row.
  SeenRow seen(int y) const {
    Row achromatic = across(kAchromatic, filters_.achromatic, y);
    Row red_green = across(kRedGreen, filters_.red_green, y);
    Row blue_yellow = across(kBlueYellow0, filters_.blue_yellow[0], y);
    const Row other = across(kBlueYellow1, filters_.blue_yellow[1], y);
    for (std::size_t x = 0; x < width_; ++x) {
      const double cz =
          filters_.blue_yellow_share[0] * blue_yellow[x] + filters_.blue_yellow_share[1] * other[x];
      Vec3d rgb = linear_from_ycxcz({achromatic[x], red_green[x], cz});
      for (int c = 0; c < 3; ++c) rgb[c] = std::clamp(rgb[c], 0.0, 1.0);
      const Vec3d lab = hunt_lab_from_linear(rgb);
      achromatic[x] = lab.x, red_green[x] = lab.y, blue_yellow[x] = lab.z;
    }
    return {
        std::move(achromatic), std::move(red_green), std::move(blue_yellow),
        lengths(across(kSlope, filters_.feature, y), across(kSmooth, filters_.feature_slope, y)),
        lengths(across(kCurve, filters_.feature, y), across(kSmooth, filters_.feature_curve, y))};
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

  void filter_row(int y) {
    Row gray(width_), channels[3] = {gray, gray, gray};
    for (std::size_t x = 0; x < width_; ++x) {
      Vec3d rgb;
      for (int c = 0; c < 3; ++c) rgb[c] = linear_from_srgb(image_.at(int(x), y, c));
      const Vec3d ycxcz = ycxcz_from_linear(rgb);
      for (int c = 0; c < 3; ++c) channels[c][x] = ycxcz[c];
      gray[x] = (ycxcz.x + 16) / 116;
    }
    along(filters_.achromatic, channels[0], kAchromatic, y);
    along(filters_.red_green, channels[1], kRedGreen, y);
    along(filters_.blue_yellow[0], channels[2], kBlueYellow0, y);
    along(filters_.blue_yellow[1], channels[2], kBlueYellow1, y);
    along(filters_.feature, gray, kSmooth, y);
    along(filters_.feature_slope, gray, kSlope, y);
    along(filters_.feature_curve, gray, kCurve, y);
  }

  // Beyond the picture its outermost pixels repeat.
  void along(const RowFilter& filter, const Row& values, Plane plane, int y) {
    const std::size_t radius = std::size_t(filter.radius());
    Row padded(radius, values.front());
    padded.insert(padded.end(), values.begin(), values.end());
    padded.insert(padded.end(), radius, values.back());
    filter_along(filter, padded.data(), planes_[plane][y - first_].data(), width_);
  }

  Row across(Plane plane, const RowFilter& filter, int y) const {
    Row out(width_);
    const auto row = [&](int d) {
      return planes_[plane][std::clamp(y + d, 0, image_.height - 1) - first_].data();
    };
    filter_rows(filter, row, out.data(), width_);
    return out;
  }

  static Row lengths(Row u, const Row& v) {
    for (std::size_t x = 0; x < u.size(); ++x) u[x] = std::sqrt(u[x] * u[x] + v[x] * v[x]);
    return u;
  }

  const ImageF& image_;
  const FlipFilters& filters_;
  std::size_t width_;
  int first_, last_;
  std::vector<Row> planes_[kPlanes];
};

// The color error of green against blue, the largest that two colors of a display have.
double largest_color_error() {
  return std::pow(hyab(hunt_lab_from_linear({0, 1, 0}), hunt_lab_from_linear({0, 0, 1})),
                  kColorExponent);
}

double color_error(const Vec3d& a, const Vec3d& b, double largest) {
  const double error = std::pow(hyab(a, b), kColorExponent), knee = kKnee * largest;
  if (error < knee) return kKneeError / knee * error;
  return kKneeError + (1 - kKneeError) * (error - knee) / (largest - knee);
}

void set_errors(const SeenRow& render, const SeenRow& photo, double largest, float* errors) {
  for (std::size_t x = 0; x < render.edge.size(); ++x) {
    const double color = color_error({render.lightness[x], render.a[x], render.b[x]},
                                     {photo.lightness[x], photo.a[x], photo.b[x]}, largest);
    const double edge = std::abs(render.edge[x] - photo.edge[x]);
    const double point = std::abs(render.point[x] - photo.point[x]);
    const double feature = std::pow(std::max(edge, point) / std::numbers::sqrt2, kFeatureExponent);
    errors[x] = float(std::clamp(std::pow(color, 1 - feature), 0.0, 1.0));
  }
}

}  // namespace

ImageF flip_map(const ImageF& render, const ImageF& photo) {
  GS_CHECK(render.width == photo.width && render.height == photo.height && render.channels == 3 &&
           photo.channels == 3 && !render.empty());
  const FlipFilters filters = flip_filters(kPixelsPerDegree);
  const double largest = largest_color_error();
  ImageF map(render.width, render.height, 1);
  parallel_chunks(std::size_t(map.height), kRowsPerThread, [&](std::size_t begin, std::size_t end) {
    const Band seen_render(render, filters, int(begin), int(end));
    const Band seen_photo(photo, filters, int(begin), int(end));
    for (int y = int(begin); y < int(end); ++y)
      set_errors(seen_render.seen(y), seen_photo.seen(y), largest, &map.at(0, y, 0));
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
