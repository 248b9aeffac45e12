// SPDX-License-Identifier: Apache-2.0
// Numbers as people read them, and names as a shell does.
#pragma once

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <cstdint>
#include <string>

namespace gs {

/// 1234567 as "1,234,567".
inline std::string with_commas(std::uint64_t value) {
  std::string text = fmt::format("{}", value);
  for (std::size_t at = text.size(); at > 3; at -= 3)
    text.insert(text.begin() + std::ptrdiff_t(at - 3), ',');
  return text;
}

/// Seconds, not negative, as "0:42", "12:05" or "1:02:05".
inline std::string clock_text(double seconds) {
  const auto whole = std::uint64_t(std::round(seconds));
  const std::uint64_t hours = whole / 3600, minutes = whole / 60 % 60;
  if (hours == 0) return fmt::format("{}:{:02}", minutes, whole % 60);
  return fmt::format("{}:{:02}:{:02}", hours, minutes, whole % 60);
}

/// Seconds, not negative, as one rounded number with a unit: "40 s", "12 min", "3.5 h".
inline std::string duration_text(double seconds) {
  if (seconds < 90) return fmt::format("{:.0f} s", seconds);
  if (seconds < 90 * 60) return fmt::format("{:.0f} min", seconds / 60);
  return fmt::format("{:.1f} h", seconds / 3600);
}

/// The text as one word of a shell command.
inline std::string shell_word(const std::string& text) {
  constexpr const char* kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789/._-+=%:,@";
  if (!text.empty() && text.find_first_not_of(kPlain) == text.npos) return text;
  std::string result = "'";
  for (const char c : text) result += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return result + "'";
}

}  // namespace gs
