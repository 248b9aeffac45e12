// SPDX-License-Identifier: Apache-2.0
// One-dimensional filters in double precision. A separable filter is one along the rows and then
// one across them.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstring>
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

/// out[x] = sum of weight(d) rows[radius + d][x], for `count` values. Sums of some neighbors at a time
/// stay in registers.
inline void filter_rows(const RowFilter& filter, const double* const* rows, double* out,
                        std::size_t count) {
  using Vector = double __attribute__((vector_size(64)));  // the compiler's own: 8 numbers
  constexpr std::size_t kAtATime = 4 * 8;
  const auto add = [](double weight, const double* from, Vector& sum) {
    Vector vector;
    std::memcpy(&vector, from, sizeof vector);
    sum += weight * vector;
  };
  const std::size_t size = filter.weights.size();
  std::size_t x = 0;
  for (; x + kAtATime <= count; x += kAtATime) {
    Vector a = {}, b = {}, c = {}, d = {};
    for (std::size_t k = 0; k < size; ++k) {
      const double weight = filter.weights[k], *const in = rows[k] + x;
      add(weight, in, a);
      add(weight, in + 8, b);
      add(weight, in + 16, c);
      add(weight, in + 24, d);
    }
    const Vector sums[] = {a, b, c, d};
    std::memcpy(out + x, sums, sizeof sums);
  }
  for (; x < count; ++x) {
    double sum = 0;
    for (std::size_t k = 0; k < size; ++k) sum += filter.weights[k] * rows[k][x];
    out[x] = sum;
  }
}

}  // namespace gs
