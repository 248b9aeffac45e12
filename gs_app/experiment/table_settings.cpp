// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/table_settings.h"

#include <string>
#include <type_traits>
#include <vector>

#include "gs_core/config/config_fields.h"
#include "gs_core/config/config_text.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

template <class T>
Json json_of(const T& value) {
  if constexpr (std::is_same_v<T, float>) {
    return std::stod(toml_text(value));  // 0.1, not 0.10000000149
  } else {
    return value;
  }
}

}  // namespace

Json settings_json(const Config& config) {
  std::vector<std::string> defaults;
  const Config usual;
  visit_fields(usual, [&](const auto& field) { defaults.push_back(toml_text(field.value)); });
  Json json = Json::object();
  std::size_t index = 0;
  visit_fields(config, [&](const auto& field) {
    if (toml_text(field.value) != defaults[index++])
      json[std::string(field.key)] = json_of(field.value);
  });
  return json;
}

Json settings_json(const Experiment& experiment, const ExperimentConfig& config) {
  return settings_json(settings_of(experiment, config));
}

Json settings_json(const ExperimentScene& scene) {
  Config config;
  Json json = Json::object();
  for (const PlacedSetting& setting : scene.settings) {
    const std::string key = apply_setting(config, setting.assignment);
    visit_fields(config, [&](const auto& field) {
      if (field.key == key) json[key] = json_of(field.value);
    });
  }
  return json;
}

}  // namespace gs
