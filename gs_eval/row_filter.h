// SPDX-License-Identifier: Apache-2.0
// One-dimensional filters in double precision. A separable filter is one along the rows and then
// one across them.
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

namespace gs {

/// The weights of a filter at the offsets -radius ... radius.
struct RowFilter {
  std::vector<double> weights;  // 2 radius + 1

  int radius() const { return int(weights.size() / 2); }
  double at(int offset) const { return weights[std::size_t(offset + radius())]; }
};

/// value(offset) for each offset from -radius to radius.
template <class Value>
RowFilter make_filter(int radius, Value&& value) {
  RowFilter filter;
  for (int offset = -radius; offset <= radius; ++offset) filter.weights.push_back(value(offset));
  return filter;
}

/// A Gaussian whose weights add up to 1.
inline RowFilter gaussian_filter(int radius, double sigma) {
  RowFilter filter = make_filter(
      radius, [&](int offset) { return std::exp(-offset * offset / (2 * sigma * sigma)); });
  double sum = 0;
  for (const double weight : filter.weights) sum += weight;
  for (double& weight : filter.weights) weight /= sum;
  return filter;
}

/// out[x] = sum of weight(d) row(d)[x], for `count` values. Sums of a few neighbors at a time stay in
/// registers.
template <class RowAt>
void filter_rows(const RowFilter& filter, RowAt&& row, double* out, std::size_t count) {
  constexpr std::size_t kAtATime = 16;
  const int radius = filter.radius();
  std::size_t x = 0;
  for (; x + kAtATime <= count; x += kAtATime) {
    double sums[kAtATime] = {};
    for (int d = -radius; d <= radius; ++d) {
      const double* in = row(d) + x;
      const double weight = filter.at(d);
      for (std::size_t i = 0; i < kAtATime; ++i) sums[i] += weight * in[i];
    }
    for (std::size_t i = 0; i < kAtATime; ++i) out[x + i] = sums[i];
  }
  for (; x < count; ++x) {
    out[x] = 0;
    for (int d = -radius; d <= radius; ++d) out[x] += filter.at(d) * row(d)[x];
  }
}

/// The filter along a row: out[x] = sum of weight(d) in[x + radius + d], for `count` values. `in` has
/// count + 2 radius.
inline void filter_along(const RowFilter& filter, const double* in, double* out,
                         std::size_t count) {
  filter_rows(
      filter, [&](int d) { return in + filter.radius() + d; }, out, count);
}

}  // namespace gs
