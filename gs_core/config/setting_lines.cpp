// SPDX-License-Identifier: Apache-2.0
#include "gs_core/config/setting_lines.h"

#include <algorithm>

#include "gs_core/config/config_fields.h"
#include "gs_core/config/config_text.h"

namespace gs {

std::string setting_lines(const Config& config) {
  std::string text;
  visit_fields(config, [&](const auto& field) {
    text += fmt::format("{} = {}\n", field.key, toml_text(field.value));
  });
  return text;
}

Config config_of_lines(const std::string& text) {
  Config config;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    apply_setting(config, text.substr(begin, end - begin));
    begin = end + 1;
  }
  return config;
}

}  // namespace gs
