// SPDX-License-Identifier: Apache-2.0
#include "gs_core/config/config_diff.h"

#include <algorithm>

#include "gs_core/config/text/config_text.h"

namespace gs {

std::vector<SettingChange> config_diff(const Config& a, const Config& b) {
  std::vector<std::string> of_a;
  visit_fields(a, [&](const auto& field) { of_a.push_back(toml_text(field.value)); });
  std::vector<SettingChange> changes;
  std::size_t i = 0;
  visit_fields(b, [&](const auto& field) {
    std::string& text_a = of_a[i++];
    std::string text_b = toml_text(field.value);
    if (text_a != text_b)
      changes.push_back(
          {std::string(field.key), std::move(text_a), std::move(text_b), field.on_change});
  });
  return changes;
}

bool same_result(const Config& a, const Config& b) {
  const std::vector<SettingChange> changes = config_diff(a, b);
  return std::none_of(changes.begin(), changes.end(),
                      [](const SettingChange& change) { return change.affects_result(); });
}

}  // namespace gs
