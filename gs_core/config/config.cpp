// SPDX-License-Identifier: Apache-2.0
// Reading and checking a Config: visitors over the list in config_fields.h. config_text.cpp prints
// it.
#include "gs_core/config/config.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <optional>

#include "gs_core/config/config_fields.h"
#include "gs_core/config/config_source.h"
#include "gs_core/config/removed/removed_rules.h"
#include "gs_core/config/removed/removed_settings.h"
#include "gs_core/config/text/config_text.h"
#include "gs_core/config/text/nearest_word.h"
#include "gs_core/config/text/read_toml.h"
#include "gs_core/config/text/region_text.h"
#include "gs_core/config/text/setting_lines.h"
#include "gs_core/density/growth_method.h"
#include "gs_core/error.h"
#include "gs_core/system/text/ascii.h"
#include "gs_core/system/text/foreign_text.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// `where` is "file:line: " or empty.
[[noreturn]] void refuse(std::string_view where, std::string_view key, std::string_view value,
                         const std::string& must) {
  throw UsageError(std::string(where) + std::string(key) + " = " + shown_word(value) +
                   " cannot be used: it must be " + must);
}

// For what older versions had. `value` is TOML text.
[[noreturn]] void refuse_removed(std::string_view where, std::string_view key,
                                 std::string_view value, std::string_view why) {
  throw UsageError(
      fmt::format("{}{} = {} cannot be used: {}", where, key, shown_word(std::string(value)), why));
}

// What a number or word must be. The largest float is named only to a number beyond it.
template <class T>
std::string range_for(const T& value, const Limits& limits) {
  if constexpr (std::is_arithmetic_v<T>) {
    if (limits.high >= limits::kLargestFloat && double(value) > limits.high)
      return fmt::format("at most {:.3g}", limits.high);
  }
  return limits.text();
}

// ---- one value from TOML

// What a value of T must look like; enums are words, in quotes as text is.
template <class T>
constexpr const char* kTypeName = std::is_enum_v<T> ? "text in quotes" : "a whole number";
template <>
constexpr const char* kTypeName<bool> = "true or false";
template <>
constexpr const char* kTypeName<float> = "a number";
template <>
constexpr const char* kTypeName<std::string> = "text in quotes";
template <>
constexpr const char* kTypeName<std::vector<int>> =
    "a list of whole numbers, such as [7000, 30000]";

// The type in which a value is read from TOML. Numbers are read in a wide type, so that their range
// is checked before they are narrowed.
template <class T>
struct Wide {
  using type = std::conditional_t<std::is_floating_point_v<T>, double, std::int64_t>;
};
template <class T>
requires std::is_enum_v<T>
struct Wide<T> {
  using type = std::string;
};
template <>
struct Wide<bool> {
  using type = bool;
};
template <>
struct Wide<std::string> {
  using type = std::string;
};
template <>
struct Wide<std::vector<int>> {
  using type = std::vector<std::int64_t>;
};

// The node's value if it has the right type. A whole number is also a number.
template <class T>
std::optional<T> value_of(const toml::node& node) {
  if constexpr (std::is_same_v<T, double>) {
    return node.is_number() ? node.value<double>() : std::nullopt;
  } else if constexpr (std::is_same_v<T, std::vector<std::int64_t>>) {
    const toml::array* array = node.as_array();
    if (!array) return std::nullopt;
    T values;
    for (const toml::node& element : *array) {
      if (!element.is_integer()) return std::nullopt;
      values.push_back(*element.value_exact<std::int64_t>());
    }
    return values;
  } else {
    return node.value_exact<T>();
  }
}

template <class T>
void assign(const Field<T>& field, const toml::node& node, std::string_view where) {
  if constexpr (std::is_same_v<T, std::int64_t>) {
    if (field.limits.low == double(kAutoCount) && node.value_exact<std::string>() == "auto") {
      field.value = kAutoCount;
      return;
    }
  }
  auto value = value_of<typename Wide<T>::type>(node);
  if (!value) refuse(where, field.key, text_of(node), kTypeName<T>);
  if constexpr (std::is_same_v<typename Wide<T>::type, std::string>) {
    const std::string_view why = reason_for_removed_word(field.key, *value);
    if (!why.empty()) refuse_removed(where, field.key, text_of(node), why);
    value = std::string(current_word(field.key, *value));
  }
  if (!fits(*value, field.limits))
    refuse(where, field.key, text_of(node), range_for(*value, field.limits));
  if constexpr (std::is_same_v<T, std::vector<int>>) {
    field.value.assign(value->begin(), value->end());
  } else if constexpr (std::is_enum_v<T>) {
    field.value = value_of_word<T>(*value).value();
  } else {
    field.value = T(*value);
  }
}

// ---- keys

std::string with_underscores(std::string key) {
  std::replace(key.begin(), key.end(), '-', '_');
  return key;
}

// Keys of 0.1.0 that are spelled differently now; configs and checkpoints of older runs have them.
constexpr std::array<std::array<std::string_view, 2>, 2> kRenamedKeys = {
    {{"density.opacity_regulariser", "density.opacity_regularizer"},
     {"density.scale_regulariser", "density.scale_regularizer"}}};

// A key as config_fields.h has it, of a key as a file or a flag has it.
std::string current_key(const std::string& text) {
  const std::string key = with_underscores(text);
  for (const auto& [old_key, new_key] : kRenamedKeys)
    if (key == old_key) return std::string(new_key);
  return key;
}

// Calls visit(field) for the field of that key.
template <class Visitor>
void visit_field(Config& config, const std::string& key, std::string_view where, Visitor&& visit) {
  bool found = false;
  visit_fields(config, [&](const auto& field) {
    if (field.key != key) return;
    found = true;
    visit(field);
  });
  if (!found) refuse_key(where, key);
}

// Whether older versions had the setting, and a run with this value is as it is without it. Throws
// where it is not.
bool is_read_over(const std::string& key, const toml::node& node, std::string_view where) {
  const RemovedSetting* const removed = find_removed_setting(key);
  if (!removed) return false;
  const std::string value = text_of(node);
  if (!is_unchanged(*removed, value)) refuse_removed(where, key, value, removed->why);
  return true;
}

// ---- files

std::string place_of(const ConfigSource& source, const toml::node& node) {
  return source.shown + ":" + std::to_string(node.source().begin.line);
}

// A table without settings is checked, too: `[trian]` may be a slip of the pen.
void check_section(const std::string& section, std::string_view where) {
  bool found = false;
  Config config;
  visit_fields(config, [&](const auto& field) {
    found |= std::string_view(field.key).starts_with(section + ".");
  });
  if (!found) refuse_key(where, section);
}

// What older versions wrote for all methods that grow by a score; which one it is, the settings beside
// it say.
constexpr std::string_view kFormerStrategy = "budgeted";

void merge_section(Config& config, const ConfigSource& source, const std::string& section,
                   const toml::table& table, SettingOrigins& origins) {
  RemovedRules rules;
  std::string named;
  for (const auto& [name, node] : table) {
    const std::string place = place_of(source, node), where = place + ": ";
    const std::string key = current_key(section + "." + std::string(name.str()));
    if (is_read_over(key, node, where) || rules.take(key, node, where)) continue;
    if (key == "density.strategy") {
      named = node.value_or(std::string());
      if (named == kFormerStrategy) {
        if (growth_method(config.density.strategy).relocates) config.density.strategy = "adaptive";
        continue;
      }
    }
    visit_field(config, key, where,
                [&, &value = node](const auto& field) { assign(field, value, where); });
    origins[key] = place;
  }
  config.density.strategy = rules.resolved(config.density.strategy, named);
}

// The sections of a text.
void merge_sections(Config& config, const ConfigSource& source, const toml::table& root,
                    SettingOrigins& origins) {
  for (const auto& [section_key, section] : root) {
    const std::string section_name = with_underscores(std::string(section_key.str()));
    if (section_name == "base") continue;
    const std::string where = place_of(source, section) + ": ";
    if (!section.is_table()) refuse_key(where, section_name);
    if (section.as_table()->empty()) check_section(section_name, where);
    merge_section(config, source, section_name, *section.as_table(), origins);
  }
}

// `chain` holds the files whose base is being read.
void merge(Config& config, const std::string& name, ConfigChain& chain, SettingOrigins& origins) {
  chain.push_back(open_config(name, chain));
  const toml::table root = parse_toml(chain.back().text, chain.back().shown);
  if (const toml::node* base = root.get("base")) {
    const auto base_name = base->value_exact<std::string>();
    if (!base_name)
      refuse(place_of(chain.back(), *base) + ": ", "base", text_of(*base),
             "the name of a TOML file or preset");
    merge(config, *base_name, chain, origins);
  }
  const ConfigSource source = std::move(chain.back());
  chain.pop_back();
  merge_sections(config, source, root, origins);
}

// The value of `--set key=TEXT`: TOML if the text is valid TOML, else a bare word.
toml::table parse_value(const std::string& text) {
  toml::table parsed;
  if (text.find('\n') == text.npos) {
    try {
      parsed = parse_toml("value = " + text, "");
    } catch (const UsageError&) {
    }
  }
  if (!parsed.contains("value")) parsed.insert_or_assign("value", text);
  return parsed;
}

}  // namespace

void refuse_key(std::string_view where, const std::string& key) {
  std::vector<std::string> known;
  Config config;
  visit_fields(config, [&](const auto& field) { known.emplace_back(field.key); });
  const std::string nearest = nearest_word(key, known);
  throw UsageError(std::string(where) + "there is no setting " + shown_word(key) + "; " +
                   (nearest.empty() ? "`gemsplat train --print-config` lists all of them"
                                    : "did you mean " + nearest + "?"));
}

void load_config(Config& config, const fs::path& name, SettingOrigins* origins) {
  ConfigChain chain;
  Config merged = config;  // a file that is refused changes nothing
  SettingOrigins merged_origins;
  merge(merged, name.string(), chain, merged_origins);
  config = merged;
  if (origins)
    for (auto& [key, place] : merged_origins) (*origins)[key] = std::move(place);
}

Config config_of_lines(const std::string& text) {
  constexpr const char* kShown = "settings";  // in messages
  Config config;
  SettingOrigins origins;
  merge_sections(config, {kShown, {}, {}, {}}, parse_toml(text, kShown), origins);
  return config;
}

std::string apply_setting(Config& config, const std::string& assignment) {
  const std::size_t equals = assignment.find('=');
  if (equals == assignment.npos)
    throw UsageError("the setting " + assignment + " has no value; write section.key=value");
  const std::string_view whole = assignment;
  const std::string key = current_key(std::string(trimmed(whole.substr(0, equals), " \t")));
  const std::string text(trimmed(whole.substr(equals + 1), " \t"));
  if (is_read_over(key, *parse_value(text).get("value"), "")) return key;
  if (RemovedRules rules; rules.take(key, *parse_value(text).get("value"), "")) {
    config.density.strategy = rules.resolved(config.density.strategy, "");
    return key;
  }
  visit_field(config, key, "", [&](const auto& field) {
    toml::table parsed = parse_value(text);
    // For a setting that is text or a word, 2024 and true are words like any other.
    using T = std::remove_reference_t<decltype(field.value)>;
    if constexpr (std::is_same_v<T, std::string> || std::is_enum_v<T>) {
      if (!parsed.get("value")->is_string()) parsed.insert_or_assign("value", text);
    }
    assign(field, *parsed.get("value"), "");
  });
  return key;
}

void validate(const Config& config, const SettingOrigins& origins) {
  const auto where = [&](std::string_view key) {
    const auto origin = origins.find(key);
    return origin == origins.end() ? std::string() : origin->second + ": ";
  };
  visit_fields(config, [&](const auto& field) {
    if constexpr (std::is_same_v<std::remove_cvref_t<decltype(field.value)>, std::string>) {
      if (field.value.find('\0') != field.value.npos)
        refuse(where(field.key), field.key, toml_text(field.value),
               "without the character \\u0000, which no name of a file holds");
    }
    if (!fits(field.value, field.limits))
      refuse(where(field.key), field.key, toml_text(field.value),
             range_for(field.value, field.limits));
  });
  const auto require = [&](bool holds, std::string_view key, const auto& value,
                           const std::string& must) {
    if (!holds) refuse(where(key), key, toml_text(value), must);
  };
  require(config.render.near_plane < config.render.far_plane, "render.near_plane",
          config.render.near_plane, "less than render.far_plane");
  const bool has_limit =
      config.density.max_gaussians != 0 || config.density.gaussians_per_point > 0;
  const DensityConfig& density = config.density;
  require(
      has_limit || !growth_method(density.strategy).rises_to_cap(), "density.max_gaussians",
      density.max_gaussians,
      fmt::format("a number, or auto: density.strategy = \"{}\" rises to it", density.strategy));
  require(parse_region(density.region).has_value(), "density.region", density.region,
          "up to six half-spaces, each of them four numbers such as \"0,0,1,2.5\", with ; between "
          "them");
  if (config.render.order == RenderOrder::pixel) {
    require(!config.model.dynamic, "model.dynamic", true, "false where render.order = \"pixel\"");
    require(config.dataset.lens != LensUse::native, "dataset.lens", config.dataset.lens,
            "undistort or auto where render.order = \"pixel\"");
    require(growth_method(density.strategy).score_photos == 0, "density.strategy", density.strategy,
            "one without a score pass where render.order = \"pixel\"");
  }
  const TrainConfig& train = config.train;
  const double iterations = train.iterations > 0
                                ? double(train.iterations)
                                : double(train.random_start_factor) * train.most_iterations;
  const double steps = std::max(iterations, 1.0) * double(train.steps_scaler);
  require(steps + double(train.extra_steps) >= 1 && steps <= limits::kLargestInt,
          "train.steps_scaler", config.train.steps_scaler,
          "such that train.iterations times it is a count of steps");
  require(steps + double(train.extra_steps) <= limits::kLargestInt, "train.extra_steps",
          train.extra_steps, "less: with the steps of the schedule it is no count of steps");
}

}  // namespace gs
