// SPDX-License-Identifier: Apache-2.0
// Stable least-significant-digit radix sort of indices by an integer key.
#pragma once

#include <array>

#include "gs_core/buffer.h"

namespace gs {

/// Sorts `indices` by key(index), an unsigned integer, ascending; equal keys keep their order. A
/// digit that is the same in all keys costs one count and no move. `scratch` is resized to the size
/// of `indices`.
template <class Key>
void radix_sort_by_key(Span<std::uint32_t> indices, Buffer<std::uint32_t>& scratch, Key&& key) {
  using KeyType = decltype(key(std::uint32_t(0)));
  constexpr int kDigitBits = 11, kDigits = 1 << kDigitBits;
  scratch.resize_discard(indices.size);
  Span<std::uint32_t> from = indices, to = scratch.span();
  for (int shift = 0; shift < int(8 * sizeof(KeyType)); shift += kDigitBits) {
    const auto digit = [&](std::uint32_t i) {
      return std::size_t(key(i) >> shift) & (kDigits - 1);
    };
    std::array<std::uint32_t, kDigits> start{};
    for (const std::uint32_t i : from) ++start[digit(i)];
    if (!from.empty() && start[digit(from[0])] == from.size) continue;
    std::uint32_t sum = 0;
    for (std::uint32_t& s : start) sum += std::exchange(s, sum);
    for (const std::uint32_t i : from) to[start[digit(i)]++] = i;
    std::swap(from, to);
  }
  if (from.data != indices.data) std::copy(from.begin(), from.end(), indices.begin());
}

}  // namespace gs
