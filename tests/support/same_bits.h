// SPDX-License-Identifier: Apache-2.0
// Whether arrays and Gaussians are the same to the last bit.
#pragma once

#include <cstring>

#include "gs_core/gaussians.h"

namespace gs {

inline bool same_bits(const ByteBuffer& a, const ByteBuffer& b) {
  return a.row_bytes() == b.row_bytes() && a.size() == b.size() &&
         (a.empty() || std::memcmp(a.bytes(), b.bytes(), a.size_bytes()) == 0);
}
inline bool same_bits(const ConstColumns& a, const ConstColumns& b) {
  bool same = a.size() == b.size();
  for (std::size_t k = 0; same && k < a.size(); ++k) same = same_bits(*a[k].rows, *b[k].rows);
  return same;
}
inline bool same_bits(const Gaussians& a, const Gaussians& b) {
  return same_bits(a.columns(), b.columns());
}

}  // namespace gs
