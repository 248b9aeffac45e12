// SPDX-License-Identifier: Apache-2.0
// Numbers of .rad files as bytes, and back. Values come Gaussian by Gaussian, (count, numbers);
// bytes hold all values of the first number, then all of the second, and so on.
//
//   f32, f16                 floats of 32 and 16 bits (IEEE 754)
//   f32_lebytes, f16_lebytes all lowest bytes, then all second bytes, ...
//   r8                       0..255 are min..max
//   s8                       -127..127 are -max..max
//   r8_delta, s8_delta       the same; of each number, the difference to the Gaussian before
//   ln_f16                   logarithms as f16
//   ln_0r8                   0 is 0; 1..255 are min..max of logarithms
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "gs_core/types.h"

namespace gs {

std::string f32_lebytes(const std::vector<float>& values, std::size_t numbers);
std::string f16_planes(const std::vector<float>& values, std::size_t numbers);
std::string s8_planes(const std::vector<float>& values, std::size_t numbers, float max);

/// Bytes of a value in an encoding; 0 for an unknown one.
std::size_t bytes_of_encoding(std::string_view encoding);

/// (count, numbers) of bytes that are bytes_of_encoding() * count * numbers. The encoding is known.
std::vector<float> decoded(std::string_view encoding, std::string_view bytes, std::size_t count,
                           std::size_t numbers, float min, float max);

/// oct88r8: the axis of rotation on an octahedron that is folded into a square, one byte for each
/// side of it, and a byte for the angle, 0 to pi.
inline constexpr std::size_t kOctBytes = 3;
void append_oct88r8(std::string& to, const Quatf& rotation);  // of length 1
Quatf from_oct88r8(const std::uint8_t* bytes);

}  // namespace gs
