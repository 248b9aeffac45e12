// SPDX-License-Identifier: Apache-2.0
// Collects the results of self checks, and helpers for the numbers that they compare.
#pragma once

#include <cstring>
#include <string>
#include <vector>

#include "gs_app/checks/self_checks.h"
#include "gs_core/buffer.h"

namespace gs {

using Numbers = std::vector<float>;

/// The checks in order of first use. All scenes share the check of a name.
class SelfCheckList {
 public:
  /// Compares `actual` with `expected` and adds the differences to the check `what`.
  void add(const std::string& what, const std::string& scene, double tolerance,
           const Numbers& actual, const Numbers& expected);
  /// Adds differences that the caller has computed.
  void add(const std::string& what, const std::string& scene, double tolerance, std::size_t numbers,
           double largest, double rms);
  std::vector<SelfCheck> take() { return std::move(checks_); }

 private:
  SelfCheck& check_named(const std::string& what, double tolerance);

  std::vector<SelfCheck> checks_;
};

/// The floats of an array in any Memory, one after another.
template <class T>
Numbers downloaded_numbers(const Buffer<T>& array) {
  const std::vector<T> rows = array.download();
  Numbers numbers(rows.size() * sizeof(T) / sizeof(float));
  if (!rows.empty()) std::memcpy(numbers.data(), rows.data(), rows.size() * sizeof(T));
  return numbers;
}

/// `count` normally distributed numbers, the same for the same seed.
Numbers random_normals(std::size_t count, std::uint64_t seed);

}  // namespace gs
