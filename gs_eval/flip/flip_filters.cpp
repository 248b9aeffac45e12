// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/flip/flip_filters.h"

#include <algorithm>
#include <numbers>

namespace gs {
namespace {

using std::numbers::pi;

// A term a sqrt(pi / b) exp(-pi^2 r^2 / b) of a contrast filter, r in degrees.
struct ContrastTerm {
  double a, b;
};
constexpr ContrastTerm kAchromatic = {1, 0.0047}, kRedGreen = {1, 0.0053};
constexpr ContrastTerm kBlueYellow[2] = {{34.1, 0.04}, {13.5, 0.025}};

constexpr double kFeatureWidth = 0.082;  // degrees: the width that the eye sees an edge with

RowFilter contrast_filter(const ContrastTerm& term, int radius, double pixels_per_degree) {
  // exp(-pi^2 r^2 / b) is a Gaussian of sigma = sqrt(b / 2) / pi degrees.
  return gaussian_filter(radius, std::sqrt(term.b / 2) / pi * pixels_per_degree);
}

// The sum of a term over all pixels.
double weight_of(const ContrastTerm& term, int radius, double pixels_per_degree) {
  double sum = 0;
  for (int x = -radius; x <= radius; ++x) {
    const double degrees = x / pixels_per_degree;
    sum += std::exp(-pi * pi * degrees * degrees / term.b);
  }
  return term.a * std::sqrt(pi / term.b) * sum * sum;
}

void scale_signs_to_one(RowFilter& filter) {
  double positive = 0, negative = 0;
  for (const double weight : filter.weights) (weight > 0 ? positive : negative) += weight;
  for (double& weight : filter.weights) weight /= weight > 0 ? positive : -negative;
}

}  // namespace

int FlipFilters::radius() const { return std::max(achromatic.radius(), feature.radius()); }

FlipFilters flip_filters(double pixels_per_degree) {
  FlipFilters filters;
  const double widest = std::max(kBlueYellow[0].b, kBlueYellow[1].b);
  const int radius = int(std::ceil(3 * std::sqrt(widest / (2 * pi * pi)) * pixels_per_degree));
  filters.achromatic = contrast_filter(kAchromatic, radius, pixels_per_degree);
  filters.red_green = contrast_filter(kRedGreen, radius, pixels_per_degree);
  double weights[2];
  for (int i = 0; i < 2; ++i) {
    filters.blue_yellow[i] = contrast_filter(kBlueYellow[i], radius, pixels_per_degree);
    weights[i] = weight_of(kBlueYellow[i], radius, pixels_per_degree);
  }
  for (int i = 0; i < 2; ++i) filters.blue_yellow_share[i] = weights[i] / (weights[0] + weights[1]);

  const double sigma = 0.5 * kFeatureWidth * pixels_per_degree;
  const int reach = int(std::ceil(3 * sigma));
  const auto gaussian = [&](int x) { return std::exp(-x * x / (2 * sigma * sigma)); };
  filters.feature = gaussian_filter(reach, sigma);
  filters.feature_slope = make_filter(reach, [&](int x) { return -x * gaussian(x); });
  filters.feature_curve =
      make_filter(reach, [&](int x) { return (x * x / (sigma * sigma) - 1) * gaussian(x); });
  scale_signs_to_one(filters.feature_slope);
  scale_signs_to_one(filters.feature_curve);
  return filters;
}

}  // namespace gs
