// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/color_correction.h"

#include <algorithm>

namespace gs {
namespace {

constexpr double kLeastVariance = 1e-8;  // of a photo, display values^2
constexpr double kLeastSlope = 1e-2;     // below it the pictures have nothing in common

}  // namespace

double ColorLine::corrected(double x) const { return std::clamp((x - offset) / slope, 0.0, 1.0); }

void ColorFit::add(double render, double photo, double share) {
  share_ += share;
  x_ += share * render;
  y_ += share * photo;
  xy_ += share * render * photo;
  yy_ += share * photo * photo;
}

ColorLine ColorFit::line() const {
  if (!(share_ > 0)) return {};
  const double x = x_ / share_, y = y_ / share_;
  const double covariance = xy_ / share_ - x * y, variance = yy_ / share_ - y * y;
  const double slope = variance > kLeastVariance ? covariance / variance : 0;
  if (!(slope > kLeastSlope)) return {1, x - y};
  return {slope, x - slope * y};
}

}  // namespace gs
