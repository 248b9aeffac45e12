// SPDX-License-Identifier: Apache-2.0
#include "gs_train/metrics/ms_ssim.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/math/constants.h"
#include "gs_core/threads/parallel.h"
#include "gs_train/metrics/row_filter.h"

namespace gs {
namespace {

// Wang et al. 2003, from the finest scale to the coarsest
constexpr std::array<double, 5> kExponents = {0.0448, 0.2856, 0.3001, 0.2363, 0.1333};
constexpr double kWindowSigma = 1.5;        // pixels
constexpr int kMoments = 5;                 // x, y, xx, yy, xy
constexpr std::size_t kRowsPerThread = 32;  // of output; each band also reads 10 rows below it

// The mean of 2x2 pixels; an odd last row or column is left out.
ImageF halved(const ImageF& image) {
  if (image.empty()) return {};
  ImageF half(image.width / 2, image.height / 2, image.channels);
  for (int y = 0; y < half.height; ++y)
    for (int x = 0; x < half.width; ++x)
      for (int c = 0; c < half.channels; ++c)
        half.at(x, y, c) = (image.at(2 * x, 2 * y, c) + image.at(2 * x + 1, 2 * y, c) +
                            image.at(2 * x, 2 * y + 1, c) + image.at(2 * x + 1, 2 * y + 1, c)) /
                           4;
  return half;
}

// Weighted sums over windows: of the contrast-structure term, of its product with the luminance
// term, and of the weights.
struct Sums {
  double structure = 0, all = 0, weight = 0;

  void operator+=(const Sums& other) {
    structure += other.structure;
    all += other.all;
    weight += other.weight;
  }
};

// One channel at one scale.
class Scale {
 public:
  Scale(const ComparedPictures& pictures, int channel)
      : pictures_(pictures), channel_(channel),
        window_(gaussian_filter(radius_for(pictures.render), kWindowSigma)),
        columns_(pictures.render.width - 2 * window_.radius()),
        rows_(pictures.render.height - 2 * window_.radius()),
        planes_(pictures.weight.empty() ? kMoments : kMoments + 1) {}

  /// Over all windows, added up row by row.
  Sums sums() const {
    std::vector<Sums> of_rows(std::size_t(rows_), Sums{});
    parallel_chunks(of_rows.size(), kRowsPerThread, [&](std::size_t begin, std::size_t end) {
      const std::vector<double> means = means_along(int(begin), int(end));
      for (std::size_t y = begin; y < end; ++y)
        of_rows[y] = sums_of_row(means, int(y) - int(begin), int(end - begin));
    });
    Sums sum;
    for (const Sums& row : of_rows) sum += row;
    return sum;
  }

  static int radius_for(const ImageF& image) {
    return std::min(kSsimRadius, (std::min(image.width, image.height) - 1) / 2);
  }

 private:
  // Windowed means along the rows [begin, end + 2 radius): (planes, rows, columns).
  std::vector<double> means_along(int begin, int end) const {
    const int width = pictures_.render.width, height = end - begin + 2 * window_.radius();
    std::vector<double> means(std::size_t(planes_) * height * columns_);
    std::vector<double> values(std::size_t(planes_) * width);
    for (int row = 0; row < height; ++row) {
      for (int x = 0; x < width; ++x) set_values(x, begin + row, &values[x]);
      for (int k = 0; k < planes_; ++k)
        filter_along(window_, &values[std::size_t(k) * width],
                     &means[(std::size_t(k) * height + row) * columns_], columns_);
    }
    return means;
  }

  // The products of one pixel, `width` values apart.
  void set_values(int x, int y, double* values) const {
    const std::size_t width = std::size_t(pictures_.render.width);
    const double a = pictures_.render.at(x, y, channel_), b = pictures_.photo.at(x, y, channel_);
    values[0] = a;
    values[width] = b;
    values[2 * width] = a * a;
    values[3 * width] = b * b;
    values[4 * width] = a * b;
    if (planes_ > kMoments) values[5 * width] = pictures_.weight.at(x, y, 0);
  }

  Sums sums_of_row(const std::vector<double>& means, int row, int rows) const {
    const int height = rows + 2 * window_.radius();
    std::array<std::vector<double>, kMoments + 1> windows;
    for (int k = 0; k < planes_; ++k) {
      windows[k].resize(std::size_t(columns_));
      filter_rows(
          window_,
          [&](int d) {
            return &means[(std::size_t(k) * height + row + window_.radius() + d) * columns_];
          },
          windows[k].data(), columns_);
    }
    Sums sums;
    const auto& [mx, my, mxx, myy, mxy, weights] = windows;
    for (int x = 0; x < columns_; ++x) {
      const double structure = (2 * (mxy[x] - mx[x] * my[x]) + kSsimC2) /
                               (mxx[x] - mx[x] * mx[x] + myy[x] - my[x] * my[x] + kSsimC2);
      const double luminance =
          (2 * mx[x] * my[x] + kSsimC1) / (mx[x] * mx[x] + my[x] * my[x] + kSsimC1);
      const double weight = planes_ > kMoments ? weights[x] : 1.0;
      sums += {weight * structure, weight * structure * luminance, weight};
    }
    return sums;
  }

  const ComparedPictures& pictures_;
  int channel_;
  RowFilter window_;
  int columns_, rows_;  // of windows within the picture
  int planes_;
};

std::size_t scales_of(const ImageF& image) {
  std::size_t scales = 1;
  int side = std::min(image.width, image.height) / 2;
  for (; scales < kExponents.size() && side > 2 * kSsimRadius; side /= 2) ++scales;
  return scales;
}

// Exponents of fewer scales are scaled to the sum of all five.
double exponent_of(std::size_t scale, std::size_t scales) {
  double all = 0, used = 0;
  for (std::size_t i = 0; i < kExponents.size(); ++i) {
    all += kExponents[i];
    if (i < scales) used += kExponents[i];
  }
  return kExponents[scale] * all / used;
}

}  // namespace

double ms_ssim(const ComparedPictures& pictures) {
  const std::size_t scales = scales_of(pictures.render);
  std::array<double, 3> products = {1, 1, 1};
  ComparedPictures scaled = pictures;
  for (std::size_t scale = 0; scale < scales; ++scale) {
    if (scale > 0) scaled = {halved(scaled.render), halved(scaled.photo), halved(scaled.weight)};
    for (int c = 0; c < 3; ++c) {
      const Sums sums = Scale(scaled, c).sums();
      GS_CHECK(sums.weight > 0);
      const double mean = (scale + 1 == scales ? sums.all : sums.structure) / sums.weight;
      products[c] *= std::pow(std::max(mean, 0.0), exponent_of(scale, scales));
    }
  }
  return (products[0] + products[1] + products[2]) / 3;
}

}  // namespace gs
