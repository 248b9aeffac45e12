// SPDX-License-Identifier: Apache-2.0
#include "gs_core/config/text/setting_lines.h"

#include "gs_core/config/config_fields.h"
#include "gs_core/config/text/config_text.h"

namespace gs {

std::string setting_lines(const Config& config) {
  std::string text;
  visit_fields(config, [&](const auto& field) {
    text += fmt::format("{} = {}\n", field.key, toml_text(field.value));
  });
  return text;
}

}  // namespace gs
