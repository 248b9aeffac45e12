// SPDX-License-Identifier: Apache-2.0
// The list that self checks are noted in, and the numbers that they compare.
#pragma once

#include <cstring>
#include <string>
#include <vector>

#include "gs_app/checks/self_checks.h"
#include "gs_core/buffer.h"

namespace gs {

using Numbers = std::vector<float>;

/// The checks in the order of first use; one of a name for all scenes.
class SelfCheckList {
 public:
  /// Notes how closely `actual` is what is expected, in a scene.
  void add(const std::string& what, const std::string& scene, double tolerance,
           const Numbers& actual, const Numbers& expected);
  /// The same of differences that were found elsewhere.
  void add(const std::string& what, const std::string& scene, double tolerance, std::size_t numbers,
           double largest, double rms);
  std::vector<SelfCheck> take() { return std::move(checks_); }

 private:
  SelfCheck& check_named(const std::string& what, double tolerance);

  std::vector<SelfCheck> checks_;
};

/// The numbers of an array of any Memory, one after another.
template <class T>
Numbers downloaded_numbers(const Buffer<T>& array) {
  const std::vector<T> rows = array.download();
  Numbers numbers(rows.size() * sizeof(T) / sizeof(float));
  if (!rows.empty()) std::memcpy(numbers.data(), rows.data(), rows.size() * sizeof(T));
  return numbers;
}

/// So many normally distributed numbers, the same ones for a seed.
Numbers random_normals(std::size_t count, std::uint64_t seed);

}  // namespace gs
