// SPDX-License-Identifier: Apache-2.0
// Figures as people read them.
#pragma once

#include <cstdint>
#include <string>

namespace gs {

/// 1234567 as "1,234,567".
inline std::string with_commas(std::uint64_t value) {
  std::string text = std::to_string(value);
  for (std::size_t at = text.size(); at > 3; at -= 3) text.insert(at - 3, ",");
  return text;
}

/// Seconds as "0:42", "12:05" or "1:02:05".
inline std::string clock_text(double seconds) {
  const auto whole = std::uint64_t(seconds > 0 ? seconds + 0.5 : 0);
  const auto two_digits = [](std::uint64_t n) { return (n < 10 ? "0" : "") + std::to_string(n); };
  const std::uint64_t hours = whole / 3600, minutes = whole / 60 % 60;
  return (hours ? std::to_string(hours) + ":" + two_digits(minutes) : std::to_string(minutes)) +
         ":" + two_digits(whole % 60);
}

}  // namespace gs
