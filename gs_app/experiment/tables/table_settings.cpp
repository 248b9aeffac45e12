// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/table_settings.h"

#include <string>

#include "gs_core/config/config_diff.h"
#include "gs_core/config/text/config_text.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

// TOML text of a value is also JSON, unless it has bytes that are not UTF-8, as paths may have.
Json json_of(const std::string& toml) {
  Json value = Json::parse(toml, nullptr, false);
  return value.is_discarded() ? Json(toml) : value;
}

}  // namespace

Json settings_json(const Config& config) {
  Json json = Json::object();
  for (const SettingChange& change : config_diff(Config{}, config))
    json[change.key] = json_of(change.b);
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
      if (field.key == key) json[key] = json_of(toml_text(field.value));
    });
  }
  return json;
}

}  // namespace gs
