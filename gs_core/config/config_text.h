// SPDX-License-Identifier: Apache-2.0
// The values of settings as TOML text that reads back to the same value.
#pragma once

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <string>
#include <type_traits>
#include <vector>

namespace gs {

std::string toml_text(const std::string& value);  // in quotes
std::string toml_text(const std::vector<int>& values);

/// The shortest text of a number or truth value; a float always looks like one.
template <class T>
std::string toml_text(T value) {
  std::string text = fmt::format("{}", value);
  if constexpr (std::is_floating_point_v<T>) {
    if (std::isfinite(value) && text.find_first_of(".e") == text.npos) text += ".0";
  }
  return text;
}

}  // namespace gs
