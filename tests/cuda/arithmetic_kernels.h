// SPDX-License-Identifier: Apache-2.0
// Compares quotient() and root() (arithmetic.h) of a GPU with the division and the square root of
// the compiler, bit by bit.
#pragma once

#include <cstdint>

namespace gs {

/// How many square roots differ, of all floats from `least` to `most`.
std::uint64_t differing_roots(float least, float most);
/// How many of `count` quotients differ. Operands are drawn with exponents up to +-`exponents`; a
/// quarter of their mantissas are near the ends of their range.
std::uint64_t differing_quotients(std::uint64_t count, int exponents);
/// The results themselves.
float root_on_gpu(float x);
float quotient_on_gpu(float a, float b);

}  // namespace gs
