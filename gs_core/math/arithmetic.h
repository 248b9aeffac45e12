// SPDX-License-Identifier: Apache-2.0
// Quotients and square roots of stage 1 and of tile rows, rounded to the nearest number.
//
// A GPU has no instruction for them. For a / b the compiler writes a chain of multiply-adds from an
// approximate reciprocal, a check whether the chain serves these operands, and a branch to a slower
// function where it does not. Where a file is compiled with GS_BRANCHLESS_QUOTIENTS, its kernels
// have the same chain, and so the same bits, without the check. Quotients by the same number then
// share its reciprocal. Stage 1 of a frame has 1,800 instead of 2,100 instructions.
#pragma once

#include <cmath>

#include "gs_core/types.h"

namespace gs {

/// a / b. Without the check it is rounded to nearest where b, a / b and a are between 2^-100 and
/// 2^100, or a is 0. It is NaN where a / b overflows or b is 0. A smaller result may be off by
/// 2^-100.
template <class T>
GS_HD T quotient(const T& a, const T& b) {
  return a / b;
}

/// The square root of x >= 0. Without the check it is rounded to nearest where x is between 2^-100
/// and 2^100, or 0.
template <class T>
GS_HD T root(const T& x) {
  using std::sqrt;
  return sqrt(x);
}

#if defined(__CUDA_ARCH__) && defined(GS_BRANCHLESS_QUOTIENTS)
GS_HD float quotient(const float& a, const float& b) {
  float inverse;
  asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(inverse) : "f"(b));
  inverse = fmaf(inverse, fmaf(-b, inverse, 1.0f), inverse);
  float q = a * inverse;
  q = fmaf(inverse, fmaf(-b, q, a), q);
  return fmaf(inverse, fmaf(-b, q, a), q);
}

GS_HD float root(const float& x) {
  float inverse;
  asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(inverse) : "f"(x));
  const float s = x * inverse;
  const float result = fmaf(0.5f * inverse, fmaf(-s, s, x), s);
  return x > 0.0f ? result : x;  // 0 has no inverse
}
#endif

}  // namespace gs
