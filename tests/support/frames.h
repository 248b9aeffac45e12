// SPDX-License-Identifier: Apache-2.0
// What tests of frames without a backward pass share: their settings, and comparisons of pictures.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "gs_render/render_pass.h"

namespace gs {

struct Picture {
  std::vector<float> image, transmittance;

  // Bit by bit, so that NaN would not pass.
  bool operator==(const Picture& other) const {
    return is_same(image, other.image) && is_same(transmittance, other.transmittance);
  }

 private:
  static bool is_same(const std::vector<float>& a, const std::vector<float>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
  }
};

inline RenderSettings for_viewing() {
  RenderSettings settings;
  settings.for_backward = false;
  settings.background = {0.25f, 0.5f, 0.75f};
  return settings;
}

/// PSNR between two pictures in dB, without the share of all numbers that differs most: a fragment
/// within rounding of a threshold may be kept in one picture and dropped from the other.
inline double psnr_of_most(const std::vector<float>& a, const std::vector<float>& b,
                           double left_out = 1e-3) {
  std::vector<double> squares(a.size());
  for (std::size_t i = 0; i < a.size(); ++i)
    squares[i] = (double(a[i]) - b[i]) * (double(a[i]) - b[i]);
  std::sort(squares.begin(), squares.end());
  squares.resize(squares.size() - std::size_t(left_out * double(squares.size())));
  double sum = 0;
  for (const double square : squares) sum += square;
  return sum > 0 ? -10 * std::log10(sum / double(squares.size()))
                 : std::numeric_limits<double>::infinity();
}

}  // namespace gs
