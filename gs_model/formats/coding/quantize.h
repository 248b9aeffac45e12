// SPDX-License-Identifier: Apache-2.0
// Numbers as small integers, for the packed formats. A number out of range becomes the nearest in
// range.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "gs_core/math/constants.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/types.h"

namespace gs {

/// round(value), between 0 and `most`; NaN is 0.
inline std::uint32_t rounded(float value, std::uint32_t most) {
  if (!(value > 0)) return 0;
  return value < float(most) ? std::uint32_t(std::lround(value)) : most;
}

/// exp(x), or the largest float.
inline float finite_exp(float x) {
  return std::min(std::exp(x), std::numeric_limits<float>::max());
}

/// 0..1 as 0..2^bits - 1, and back.
inline std::uint32_t to_unorm(float value, int bits) {
  const std::uint32_t most = (1u << bits) - 1;
  return rounded(value * float(most), most);
}
inline float from_unorm(std::uint32_t value, int bits) {
  const std::uint32_t most = (1u << bits) - 1;
  return float(value & most) / float(most);
}

/// Opacity as a byte, and back as a logit. The bytes 0 and 255 stand for half an interval each and
/// are read as its middle: the logit is finite, and the opacity still below 1/255 or near 1.
inline std::uint32_t opacity_byte(float logit_opacity) {
  return to_unorm(sigmoid(logit_opacity), 8);
}
inline float logit_of_byte(std::uint32_t byte) {
  return float(logit(byte == 0 ? 0.25 / 255 : byte == 255 ? 254.75 / 255 : byte / 255.0));
}

/// A logit between those of opacities that a float tells from 0 and from 1; NaN stays.
inline float finite_logit(float opacity) {
  constexpr double kLeast = 1e-7f;
  return std::isfinite(opacity) ? float(logit(std::clamp(double(opacity), kLeast, 1 - kLeast)))
                                : opacity;
}

/// Logarithms of scales, world units. That of 0, which was too small for a float, is that of the
/// smallest float.
inline Vec3f log_of_scale(const Vec3f& scale) {
  const auto log_of = [](float s) {
    return std::log(s <= 0 ? std::numeric_limits<float>::min() : s);
  };
  return {log_of(scale.x), log_of(scale.y), log_of(scale.z)};
}

/// Color of the SH coefficient of degree 0, and back: c = 0.5 + C0 f.
inline float color_of_sh0(float f) { return kColorOffset + float(kSh0) * f; }
inline float sh0_of_color(float c) { return (c - kColorOffset) / float(kSh0); }

/// A quaternion of length 1 without its largest component: the other three lie within +-1/sqrt(2).
/// Its sign is chosen so that the largest component is not negative, which is the same rotation.
struct SmallestThree {
  int largest;                  // its index
  std::array<float, 3> others;  // in their order
};
inline SmallestThree smallest_three(const std::array<float, 4>& q) {
  SmallestThree result{0, {}};
  for (int i = 1; i < 4; ++i)
    if (std::abs(q[i]) > std::abs(q[result.largest])) result.largest = i;
  const float sign = q[result.largest] < 0 ? -1.0f : 1.0f;
  for (int i = 0, next = 0; i < 4; ++i)
    if (i != result.largest) result.others[next++] = sign * q[i];
  return result;
}
inline std::array<float, 4> quaternion_of(const SmallestThree& parts) {
  const auto [a, b, c] = parts.others;
  std::array<float, 4> q{};
  q[parts.largest] = std::sqrt(std::fmax(0.0f, 1 - (a * a + b * b + c * c)));
  for (int i = 0, next = 0; i < 4; ++i)
    if (i != parts.largest) q[i] = parts.others[next++];
  return q;
}

inline constexpr float kSqrtHalf = 0.70710678f;  // the second-largest component is no larger

}  // namespace gs
