// SPDX-License-Identifier: Apache-2.0
// Floats of 16 bits (IEEE 754): sign, 5 bits of exponent, 10 of fraction.
#pragma once

#include <cstdint>

namespace gs {

/// The nearest one, ties to even; beyond their range the largest. `value` is finite.
std::uint16_t to_half(float value);
float from_half(std::uint16_t half);

}  // namespace gs
