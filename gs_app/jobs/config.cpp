// SPDX-License-Identifier: Apache-2.0
// gemsplat config: prints, explains and compares settings, and lists the presets.
#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_core/config/config_fields.h"
#include "gs_core/config/config_presets.h"
#include "gs_core/config/config_table.h"

namespace gs {
namespace {

struct ConfigJob : JobSettings {
  bool list = false, markdown = false, explains = false, compares = false;
  std::vector<std::string> explained;
  std::string a, b;  // of `diff`
};

void visit_options(ConfigJob& job, OptionList& option) {
  general_options(option);
  option("--list", job.list, "list the presets, and do nothing else");
  option("--markdown", job.markdown, "print docs/reference/settings.md, and do nothing else");
  OptionList& explain = option.sub_verb(
      "explain", "Print meaning, unit, range, default, source and origin of settings",
      job.explains);
  explain("keys", job.explained, "section.key, or a section [all settings]").takes("KEY");
  OptionList& diff =
      option.sub_verb("diff", "Print the settings that differ between two configs", job.compares);
  diff("a", job.a, "a TOML file, a run's folder or a preset").takes("A").required();
  diff("b", job.b, "another one [none: compare A with the defaults]").takes("B");
}

Outcome list_presets() {
  std::size_t width = 0;
  for (const Preset& preset : presets()) width = std::max(width, preset.name.size());
  Outcome outcome{"", Json::array()};
  for (const Preset& preset : presets()) {
    outcome.text += fmt::format("{:<{}} {}\n", preset.name, width, summary(preset));
    outcome.json.push_back({{"name", preset.name}, {"summary", summary(preset)}});
  }
  outcome.next = {{"train with one", "gemsplat train SCENE -c PRESET"}};
  return outcome;
}

template <class T>
Json json_value(const T& value) {
  if constexpr (std::is_enum_v<T>)
    return std::string(word_of(value));
  else
    return value;
}

// All settings: {"train": {"iterations": {"value": 0, ...}}}.
Json json_of(const Config& config, const SettingOrigins& origins) {
  Json json = Json::object();
  visit_fields(config, [&](const auto& field) {
    const std::string key(field.key);
    const std::size_t dot = key.find('.');
    const auto origin = origins.find(key);
    Json& setting = json[key.substr(0, dot)][key.substr(dot + 1)] = {
        {"value", json_value(field.value)},
        {"meaning", field.meaning},
        {"from", origin == origins.end() ? "default" : origin->second}};
    if (!field.unit.empty()) setting["unit"] = field.unit;
    if (!field.limits.words.empty()) setting["words"] = field.limits.words;
  });
  return json;
}

Outcome explain_settings(const ConfigJob& job) {
  SettingOrigins origins;
  const Config config = resolve(job, {}, &origins);
  Outcome outcome{"", json_of(config, origins)};
  if (job.explained.empty()) outcome.text = explain(config, origins, "");
  for (const std::string& key : job.explained) outcome.text += explain(config, origins, key);
  outcome.next = {{"change one", "gemsplat train SCENE --set SECTION.KEY=VALUE"}};
  return outcome;
}

// Compares two configs, or one with the defaults. -c and --set apply to both.
Outcome compare(const ConfigJob& job) {
  SettingOrigins a_origins, b_origins;
  Config a = resolve(job, {}, &a_origins), b = resolve(job, {}, &b_origins);
  if (!job.b.empty()) load_config(a, job.a, &a_origins);
  load_config(b, job.b.empty() ? job.a : job.b, &b_origins);
  const std::string text = difference(a, a_origins, b, b_origins);
  return {text.empty() ? "no setting differs\n" : text,
          {{"a", json_of(a, a_origins)}, {"b", json_of(b, b_origins)}},
          {{"what they mean", "gemsplat config explain SECTION.KEY"}}};
}

Outcome answer(const ConfigJob& job) {
  if (job.list) return list_presets();
  if (job.markdown) return {config_markdown()};
  if (job.explains) return explain_settings(job);
  if (job.compares) return compare(job);
  SettingOrigins origins;
  const Config config = resolve(job, {}, &origins);
  return {to_toml(config),
          json_of(config, origins),
          {{"train with them", "gemsplat train SCENE -c FILE"}}};
}

Outcome run(const ConfigJob& job, JobEvents&) {
  Outcome outcome = answer(job);
  outcome.is_answer = true;
  return outcome;
}

}  // namespace

Verb config_verb() {
  return verb_of<ConfigJob>(
      "config", VerbGroup::check,
      "Print, explain and compare settings; without a verb, print all of them as TOML",
      {"config --list", "config explain density", "config diff out/scene fast"});
}

}  // namespace gs
