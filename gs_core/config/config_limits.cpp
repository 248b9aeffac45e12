// SPDX-License-Identifier: Apache-2.0
#include "gs_core/config/config_limits.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

namespace gs {

bool Limits::allow(double value) const {
  return (above_low ? value > low : value >= low) && value <= high;
}

bool Limits::allow(std::string_view word) const {
  if (words.empty()) return true;
  // "cuda:3" is looked up as "cuda:N".
  const std::size_t colon = word.find(':');
  const bool is_numbered = colon != word.npos && colon + 1 < word.size() &&
                           word.find_first_not_of("0123456789", colon + 1) == word.npos;
  if (colon != word.npos && !is_numbered) return false;
  const std::string wanted = std::string(word.substr(0, colon)) + (is_numbered ? ":N" : "");
  for (std::string_view rest = words; !rest.empty();) {
    const std::size_t comma = std::min(rest.find(", "), rest.size());
    if (rest.substr(0, comma) == wanted) return true;
    rest.remove_prefix(std::min(comma + 2, rest.size()));
  }
  return false;
}

std::string Limits::text() const {
  if (!words.empty()) return fmt::format("one of {}", words);
  if (above_low) return fmt::format("above {}", low);
  if (high >= limits::kLargestFloat) return fmt::format("at least {}", low);
  return fmt::format("from {} to {:.{}f}", low, high, high == std::floor(high) ? 0 : 3);
}

}  // namespace gs
