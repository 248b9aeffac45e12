// SPDX-License-Identifier: Apache-2.0
// Words of text as numbers, independent of the locale.
#pragma once

#include <charconv>
#include <string_view>

namespace gs {

/// Reads the whole word, with or without a plus sign. False if it is not a T, or out of range.
template <class T>
bool parse_number(std::string_view word, T& value) {
  if (!word.empty() && word[0] == '+') word.remove_prefix(1);
  const char* end = word.data() + word.size();
  const auto [rest, error] = std::from_chars(word.data(), end, value);
  return error == std::errc() && rest == end;
}

/// Parses a float. A number beyond the range of float becomes 0 or infinity.
inline bool parse_float(std::string_view word, float& value) {
  if (parse_number(word, value)) return true;
  double wide;
  if (!parse_number(word, wide)) return false;
  value = static_cast<float>(wide);
  return true;
}

}  // namespace gs
