// SPDX-License-Identifier: Apache-2.0
// Small changes of texts.
#pragma once

#include <string>
#include <string_view>

namespace gs {

/// The text with ASCII letters in lower case. Other letters stay: file systems disagree on them.
inline std::string lowercase(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = char(c - 'A' + 'a');
  return text;
}

/// The text without blanks at both ends.
inline std::string_view trimmed(std::string_view text, std::string_view blanks = " \t\r") {
  const std::size_t first = text.find_first_not_of(blanks);
  if (first == text.npos) return {};
  return text.substr(first, text.find_last_not_of(blanks) - first + 1);
}

}  // namespace gs
