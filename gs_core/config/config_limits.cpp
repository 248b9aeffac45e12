// SPDX-License-Identifier: Apache-2.0
#include "gs_core/config/config_limits.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

namespace gs {

namespace {

// Whether a text such as "1, 2, 4, 8" or "auto, cpu" has this element.
bool is_in_list(std::string_view list, std::string_view wanted) {
  while (!list.empty()) {
    const std::size_t comma = std::min(list.find(", "), list.size());
    if (list.substr(0, comma) == wanted) return true;
    list.remove_prefix(std::min(comma + 2, list.size()));
  }
  return false;
}

}  // namespace

bool Limits::allow(double value) const {
  const bool is_in_range = (above_low ? value > low : value >= low) && value <= high;
  return is_in_range || is_in_list(also, fmt::format("{}", value));
}

bool Limits::allow(std::string_view word) const {
  if (words.empty()) return true;
  // "cuda:3" is looked up as "cuda:N".
  const std::size_t colon = word.find(':');
  const bool is_numbered = colon != word.npos && colon + 1 < word.size() &&
                           word.find_first_not_of("0123456789", colon + 1) == word.npos;
  if (colon != word.npos && !is_numbered) return false;
  return is_in_list(words, std::string(word.substr(0, colon)) + (is_numbered ? ":N" : ""));
}

std::string Limits::text() const {
  if (!words.empty()) return fmt::format("one of {}", words);
  if (above_low) return fmt::format("above {}", low);
  if (high >= limits::kLargestFloat) return fmt::format("at least {}", low);
  return fmt::format("{}{}from {} to {:.{}f}", also, also.empty() ? "" : ", or ", low, high,
                     high == std::floor(high) ? 0 : 3);
}

}  // namespace gs
