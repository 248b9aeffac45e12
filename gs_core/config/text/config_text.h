// SPDX-License-Identifier: Apache-2.0
// Values of settings as TOML text, which reads back to the same value.
#pragma once

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <string>
#include <type_traits>
#include <vector>

#include "gs_core/config/config_words.h"

namespace gs {

std::string toml_text(const std::string& value);  // in quotes
std::string toml_text(const std::vector<int>& values);

/// The word of an enum, in quotes.
template <class E>
requires std::is_enum_v<E> std::string toml_text(E value) {
  return toml_text(std::string(word_of(value)));
}

/// The shortest text of a number or truth value. A float always has a point or an exponent.
template <class T>
std::string toml_text(T value) {
  std::string text = fmt::format("{}", value);
  if constexpr (std::is_floating_point_v<T>) {
    if (std::isfinite(value) && text.find_first_of(".e") == text.npos) text += ".0";
  }
  return text;
}

}  // namespace gs
