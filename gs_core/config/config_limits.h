// SPDX-License-Identifier: Apache-2.0
// Which values a setting may have.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <type_traits>

#include "gs_core/config/config_words.h"

namespace gs {

/// A range of numbers, [low, high], or (low, high] if `above_low`; or a list of words. NaN is never
/// allowed.
struct Limits {
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
  bool above_low = false;
  std::string_view words = {};  // separated by ", "; a word "cuda:N" stands for cuda:0, cuda:1, ...
  std::string_view also = {};   // whole numbers below the range, such as "1, 2, 4, 8"

  bool allow(double value) const;
  bool allow(std::string_view word) const;
  /// "from 0 to 3", "at least 1", "one of black, white, random", "1, 2, 4, 8, or from 16 to 65536"
  std::string text() const;
};

namespace limits {
inline constexpr double kLargestFloat = std::numeric_limits<float>::max();
inline constexpr double kLargestInt = std::numeric_limits<int>::max();
inline constexpr double kLargestExact = 9007199254740992.0;  // 2^53: whole in every JSON reader

constexpr Limits any() { return {}; }
constexpr Limits one_of(std::string_view words) { return {.words = words}; }
/// One of the words of an enum (config_words.h).
template <class E>
Limits one_of() {
  return {.words = joined_words<E>()};
}
constexpr Limits between(double low, double high) { return {.low = low, .high = high}; }
constexpr Limits one_of_or_between(std::string_view also, double low, double high) {
  return {.low = low, .high = high, .also = also};
}
constexpr Limits at_least(double low) { return {.low = low, .high = kLargestFloat}; }
constexpr Limits above(double low) {
  return {.low = low, .high = kLargestFloat, .above_low = true};
}
constexpr Limits steps_from(double low) { return {.low = low, .high = kLargestInt}; }
}  // namespace limits

/// Whether the limits allow a field's value. A list fits if each of its elements does.
template <class T>
bool fits(const T& value, const Limits& limits) {
  if constexpr (std::is_same_v<T, bool>) {
    return true;
  } else if constexpr (std::is_arithmetic_v<T>) {
    return limits.allow(double(value));
  } else if constexpr (std::is_enum_v<T>) {
    return limits.allow(word_of(value));
  } else if constexpr (std::is_same_v<T, std::string>) {
    return limits.allow(std::string_view(value));
  } else {
    for (const auto element : value)
      if (!limits.allow(double(element))) return false;
    return true;
  }
}

}  // namespace gs
