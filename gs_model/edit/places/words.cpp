// SPDX-License-Identifier: Apache-2.0
#include "gs_model/edit/places/words.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/system/text/parse_number.h"

namespace gs {
namespace {

constexpr std::string_view kRange = "..";

}  // namespace

std::vector<double> numbers_of_list(std::string_view text, std::size_t count,
                                    const std::string& what) {
  std::vector<double> numbers;
  for (std::string_view left = text; !left.empty() || numbers.empty();) {
    const std::size_t end = std::min(left.find(','), left.size());
    double value;
    if (!parse_number(left.substr(0, end), value) || !std::isfinite(value))
      throw UsageError(
          fmt::format("{}: \"{}\" is no number; give {} with commas between and "
                      "without spaces",
                      what, left.substr(0, end), count));
    numbers.push_back(value);
    left.remove_prefix(std::min(end + 1, left.size()));
  }
  if (numbers.size() != count)
    throw UsageError(
        fmt::format("{}: these are {} numbers, and it takes {}", what, numbers.size(), count));
  return numbers;
}

Interval interval_of(const std::string& what, std::string_view text) {
  const auto number = [&](std::string_view word, double if_empty) {
    double value = if_empty;
    if (!word.empty() && (!parse_number(word, value) || std::isnan(value)))
      throw UsageError(
          fmt::format("{}: \"{}\" is no number; a range is written LOW..HIGH, and one "
                      "of the two may be left out, as in {}=0.5..",
                      what, word, what.substr(0, what.find('='))));
    return value;
  };
  const Interval all;
  const std::size_t dots = text.find(kRange);
  Interval interval{number(text.substr(0, dots), all.low), 0};
  interval.high =
      dots == text.npos ? interval.low : number(text.substr(dots + kRange.size()), all.high);
  const bool says_nothing = text.empty() || text == kRange;
  if (says_nothing || interval.low > interval.high)
    throw UsageError(
        fmt::format("{}: \"{}\" is no range; write LOW..HIGH, and leave out one of the "
                    "two at most",
                    what, text));
  return interval;
}

}  // namespace gs
