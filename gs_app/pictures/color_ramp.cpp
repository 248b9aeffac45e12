// SPDX-License-Identifier: Apache-2.0
#include "gs_app/pictures/color_ramp.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace gs {
namespace {

/// Oklab (L, a, b) to sRGB.             Ottosson 2020, "A perceptual color space"
Rgb srgb_from_oklab(double L, double a, double b) {
  const double l = std::pow(L + 0.3963377774 * a + 0.2158037573 * b, 3);
  const double m = std::pow(L - 0.1055613458 * a - 0.0638541728 * b, 3);
  const double s = std::pow(L - 0.0894841775 * a - 1.2914855480 * b, 3);
  const std::array<double, 3> linear = {4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
                                        -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
                                        -0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s};
  Rgb rgb{};
  for (int c = 0; c < 3; ++c) {
    const double v = std::clamp(linear[c], 0.0, 1.0);
    const double encoded = v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055;
    rgb[c] = std::uint8_t(encoded * 255 + 0.5);
  }
  return rgb;
}

std::array<Rgb, 256> make_ramp() {
  std::array<Rgb, 256> ramp;
  for (int i = 0; i < 256; ++i) {
    const double t = i / 255.0;
    const double lightness = 0.08 + 0.89 * t;
    const double chroma =
        0.19 * std::pow(std::sin(std::numbers::pi * std::min(0.03 + 0.86 * t, 1.0)), 0.8);
    // From violet through red to yellow.
    const double hue = (290 + 175 * t) * std::numbers::pi / 180;
    ramp[i] = srgb_from_oklab(lightness, chroma * std::cos(hue), chroma * std::sin(hue));
  }
  return ramp;
}

}  // namespace

const std::array<Rgb, 256>& color_ramp() {
  static const std::array<Rgb, 256> ramp = make_ramp();
  return ramp;
}

}  // namespace gs
