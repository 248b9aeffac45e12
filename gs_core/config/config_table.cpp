// SPDX-License-Identifier: Apache-2.0
// Visitors over the list in config_fields.h that write texts for people.
#include "gs_core/config/config_table.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <vector>

#include "gs_core/config/config_diff.h"
#include "gs_core/config/config_fields.h"
#include "gs_core/config/config_presets.h"
#include "gs_core/config/text/config_text.h"
#include "gs_core/config/text/markdown.h"
#include "gs_core/config/text/nearest_word.h"
#include "gs_core/error.h"
#include "gs_core/system/text/foreign_text.h"

namespace gs {
namespace {

constexpr std::string_view kIntroduction =
    "# Configuration\n"
    "\n"
    "This page lists every setting. The program writes it from the one list of them\n"
    "([config_fields.h](../../gs_core/config/config_fields.h)):\n"
    "```\n"
    "gemsplat config --markdown > docs/reference/settings.md\n"
    "```\n"
    "A run takes its settings from these sources; a later one wins:\n"
    "\n"
    "1. the defaults,\n"
    "2. `-c`, any number of times: a TOML file, the folder of another run, or a preset,\n"
    "3. `--set section.key=value`,\n"
    "4. flags.\n"
    "\n"
    "A file may begin with `base = \"NAME\"`, a preset or a file beside it. The base "
    "is read first, and may\n"
    "have a base, too. An unknown key or a value out of range is refused, with file, "
    "line, key and the\n"
    "nearest known key.\n"
    "```\n"
    "gemsplat config -c fast --set train.seed=7   # prints the resolved settings, as "
    "a file for -c\n"
    "gemsplat config explain density -c fast      # explains settings, their ranges "
    "and their origin\n"
    "gemsplat config diff out/a out/b             # compares two runs, files or presets\n"
    "gemsplat config --list                       # lists the presets\n"
    "```\n";

std::string section_of(std::string_view key) { return std::string(key.substr(0, key.find('.'))); }

[[noreturn]] void refuse_section_or_key(const std::string& wanted) {
  std::vector<std::string> sections;
  Config config;
  visit_fields(config, [&](const auto& field) {
    if (sections.empty() || sections.back() != section_of(field.key))
      sections.emplace_back(section_of(field.key));
  });
  const std::string nearest =
      wanted.find('.') == wanted.npos ? nearest_word(wanted, sections) : std::string();
  if (nearest.empty()) refuse_key("", wanted);
  throw UsageError(fmt::format("there is no section of settings {}; did you mean {}?",
                               shown_word(wanted), nearest));
}

// Which values a setting takes, in words; empty if it takes any.
template <class T>
std::string range_text(const Field<T>& field) {
  if constexpr (std::is_same_v<std::remove_const_t<T>, bool>) return "true or false";
  const Limits& limits = field.limits;
  const bool is_free = limits.words.empty() && std::isinf(limits.low) && std::isinf(limits.high);
  if (is_free) return "";
  const bool is_open =
      limits.words.empty() && !limits.above_low && limits.high >= limits::kLargestInt;
  return is_open ? fmt::format("at least {}", limits.low) : limits.text();
}

// The default values as text, in the order of the list.
std::vector<std::string> default_values() {
  std::vector<std::string> values;
  const Config config;
  visit_fields(config, [&](const auto& field) { values.push_back(toml_text(field.value)); });
  return values;
}

std::string settings_tables() {
  std::string text, section;
  const Config config;
  visit_fields(config, [&](const auto& field) {
    if (section_of(field.key) != section) {
      section = section_of(field.key);
      text += "\n## " + section + "\n" +
              markdown_header({"setting", "default", "unit", "range", "meaning", "source"});
    }
    const auto code = [](std::string_view words) { return fmt::format("`{}`", words); };
    text += markdown_row({code(field.key.substr(section.size() + 1)), code(toml_text(field.value)),
                          std::string(field.unit), range_text(field), std::string(field.meaning),
                          std::string(field.source)});
  });
  return text;
}

// "`density.every` = 200 (100)" for each setting that the preset changes.
std::string changes_of(const Preset& preset) {
  Config config;
  load_config(config, std::string(preset.name));
  std::vector<std::string> changes;
  for (const SettingChange& change : config_diff(Config{}, config))
    changes.push_back(fmt::format("`{}` = {} ({})", change.key, change.b, change.a));
  return fmt::format("{}", fmt::join(changes, ", "));
}

std::string presets_table() {
  std::string text =
      "\n## Presets\n"
      "Presets are files of [configs/](../../configs) that are part of the program. Use one by `-c "
      "fast`, or\nby `base = \"fast\"` in a file of your own.\n\n" +
      markdown_header({"preset", "what it is", "what differs (from)"});
  for (const Preset& preset : presets())
    text += markdown_row(
        {fmt::format("`{}`", preset.name), std::string(summary(preset)), changes_of(preset)});
  return text;
}

std::string origin_of(const SettingOrigins& origins, std::string_view key) {
  const auto origin = origins.find(key);
  return origin == origins.end() ? "default" : origin->second;
}

}  // namespace

std::string config_markdown() {
  return std::string(kIntroduction) + settings_tables() + presets_table();
}

std::string explain(const Config& config, const SettingOrigins& origins,
                    const std::string& wanted) {
  std::string key = wanted;
  std::replace(key.begin(), key.end(), '-', '_');
  const std::vector<std::string> defaults = default_values();
  std::string text;
  std::size_t index = 0;
  visit_fields(config, [&](const auto& field) {
    const std::string& usual = defaults[index++];
    const std::string range = range_text(field);
    if (!key.empty() && key != field.key && key != section_of(field.key)) return;
    text += fmt::format("{} = {}\n  from     {}\n  meaning  {}\n", field.key,
                        toml_text(field.value), origin_of(origins, field.key), field.meaning);
    if (!field.unit.empty()) text += fmt::format("  unit     {}\n", field.unit);
    if (!range.empty()) text += fmt::format("  range    {}\n", range);
    text += fmt::format("  default  {}\n", usual);
    if (!field.source.empty()) text += fmt::format("  source   {}\n", field.source);
  });
  if (text.empty()) refuse_section_or_key(key);
  return text;
}

std::string difference(const Config& a, const SettingOrigins& a_origins, const Config& b,
                       const SettingOrigins& b_origins) {
  std::string text;
  for (const SettingChange& change : config_diff(a, b))
    text += fmt::format("{} = {} -> {}  ({} -> {})\n", change.key, change.a, change.b,
                        origin_of(a_origins, change.key), origin_of(b_origins, change.key));
  return text;
}

}  // namespace gs
