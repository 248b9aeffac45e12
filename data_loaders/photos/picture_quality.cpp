// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/picture_quality.h"

#include <algorithm>
#include <cmath>

#include "data_loaders/photos/photos.h"

namespace gs {
namespace {

constexpr std::size_t kFewestForOutliers = 5;
constexpr double kDeviations = 3.5;
constexpr double kBlurFactor = 4, kExposureFactor = 2;
constexpr double kNormal = 1.4826;  // standard deviation over median absolute deviation

double median(std::vector<double> values) {
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Signed distances of the values' logarithms from their median, in units of log(factor). A distance
// within the usual deviation counts as 0.
std::vector<double> distances(const std::vector<double>& values, double factor) {
  std::vector<double> logs, deviations, result;
  for (const double value : values) logs.push_back(std::log(std::max(value, 1e-3)));
  const double center = median(logs);
  for (const double value : logs) deviations.push_back(std::abs(value - center));
  const double usual = kNormal * median(deviations);
  for (const double value : logs) {
    const double distance = value - center;
    result.push_back(std::abs(distance) > kDeviations * usual ? distance / std::log(factor) : 0);
  }
  return result;
}

}  // namespace

PictureQuality quality_of(const Image8& photo) {
  const int width = std::min(photo.width, kQualityWidth);
  const int height = std::max(1, int(std::lround(double(photo.height) * width / photo.width)));
  const Image8 small = area_resized(photo, width, height);
  const auto luma = [&](int x, int y) {  // ITU-R BT.601
    return 0.299 * small.at(x, y, 0) + 0.587 * small.at(x, y, 1) + 0.114 * small.at(x, y, 2);
  };
  double sum = 0, laplacian_sum = 0, laplacian_squares = 0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      sum += luma(x, y);
      if (x == 0 || y == 0 || x + 1 == width || y + 1 == height) continue;
      const double laplacian =
          luma(x - 1, y) + luma(x + 1, y) + luma(x, y - 1) + luma(x, y + 1) - 4 * luma(x, y);
      laplacian_sum += laplacian;
      laplacian_squares += laplacian * laplacian;
    }
  const double inner = std::max(1.0, double(width - 2) * (height - 2));
  const double mean = laplacian_sum / inner;
  return {laplacian_squares / inner - mean * mean, sum / (double(width) * height)};
}

QualityOutliers outliers_of(const std::vector<PictureQuality>& qualities) {
  QualityOutliers outliers;
  if (qualities.size() < kFewestForOutliers) return outliers;
  std::vector<double> sharpness, brightness;
  for (const PictureQuality& quality : qualities) {
    sharpness.push_back(quality.sharpness);
    brightness.push_back(quality.brightness);
  }
  const std::vector<double> by_sharpness = distances(sharpness, kBlurFactor);
  const std::vector<double> by_brightness = distances(brightness, kExposureFactor);
  for (std::size_t i = 0; i < qualities.size(); ++i) {
    if (by_sharpness[i] < -1) outliers.blurred.push_back(i);
    if (std::abs(by_brightness[i]) > 1) outliers.odd_exposure.push_back(i);
  }
  return outliers;
}

}  // namespace gs
