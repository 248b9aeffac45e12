// SPDX-License-Identifier: Apache-2.0
// Whether arrays and Gaussians are the same to the last bit.
#pragma once

#include <cstring>

#include "gs_core/gaussians.h"

namespace gs {

template <class T>
bool same_bits(const Buffer<T>& a, const Buffer<T>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}
inline bool same_bits(const Gaussians& a, const Gaussians& b) {
  bool same = a.has_filter == b.has_filter;
  for_each_stored_array([&](const char*, const auto& x, const auto& y) { same &= same_bits(x, y); },
                        a, b);
  return same;
}

}  // namespace gs
