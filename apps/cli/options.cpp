// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/options.h"

#include <CLI/CLI.hpp>
#include <algorithm>

#include "apps/cli/foreign_flags.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/config/config_fields.h"
#include "gs_core/error.h"

namespace gs {
namespace {

// What --help says of a setting.
struct SettingHelp {
  std::string meaning, placeholder, preset;
  bool is_switch = false, is_list = false;
};

std::string upper(std::string_view text) {
  std::string result(text);
  std::transform(result.begin(), result.end(), result.begin(),
                 [](unsigned char c) { return std::toupper(c); });
  return result;
}

SettingHelp help_of(const std::string& key) {
  SettingHelp help;
  const Config config;
  visit_fields(config, [&](const auto& field) {
    if (field.key != key) return;
    using T = std::remove_cvref_t<decltype(field.value)>;
    help.meaning = field.meaning;
    help.is_switch = std::is_same_v<T, bool>;
    help.is_list = std::is_same_v<T, std::vector<int>>;
    if constexpr (std::is_arithmetic_v<T>) help.preset = fmt::format("{}", field.value);
    if constexpr (std::is_same_v<T, std::string>) help.preset = field.value;
    if constexpr (std::is_enum_v<T>) help.preset = word_of(field.value);
    help.placeholder = field.unit.empty() ? "N" : upper(field.unit);
    if (!field.limits.words.empty()) {
      help.placeholder = field.limits.words;
      for (std::size_t comma; (comma = help.placeholder.find(", ")) != help.placeholder.npos;)
        help.placeholder.replace(comma, 2, "|");
    }
  });
  GS_CHECK(!help.meaning.empty());
  return help;
}

std::string joined(const std::vector<std::string>& words) {
  std::string result;
  for (const std::string& word : words) result += (result.empty() ? "" : ", ") + word;
  return result;
}

// Applies a flag. Where its value means something to other trainers, the refusal says what to give here.
std::string apply_flag(Config& config, const std::string& flag) {
  try {
    return apply_setting(config, flag);
  } catch (const UsageError& error) {
    const std::string own = own_value(flag);
    throw UsageError(error.what() + (own.empty() ? "" : "; here that is " + own));
  }
}

}  // namespace

Verbosity CommandLine::verbosity() const {
  return quiet ? Verbosity::quiet : verbose ? Verbosity::verbose : Verbosity::normal;
}

bool CommandLine::has(const std::string& key) const {
  return std::any_of(flags.begin(), flags.end(),
                     [&](const std::string& flag) { return flag.starts_with(key + "="); });
}

void add_setting(CLI::App& verb, CommandLine& line, const std::string& names,
                 const std::string& key, const std::string& group, const std::string& help) {
  const SettingHelp setting = help_of(key);
  std::string text = help.empty() ? setting.meaning : help;
  if (!setting.is_switch && !setting.preset.empty()) text += " [" + setting.preset + "]";
  const auto keep = [&line, key](const std::string& value) {
    line.flags.push_back(key + "=" + value);
  };
  if (setting.is_switch) {
    verb.add_flag_callback(
            names, [keep] { keep("true"); }, text)
        ->group(group);
  } else if (setting.is_list) {
    const auto keep_list = [keep](const std::vector<std::string>& words) {
      keep("[" + joined(words) + "]");
    };
    verb.add_option_function<std::vector<std::string>>(names, keep_list, text)
        ->delimiter(',')
        ->type_name(setting.placeholder)
        ->group(group);
  } else {
    verb.add_option_function<std::string>(names, keep, text)
        ->take_last()
        ->type_name(setting.placeholder)
        ->group(group);
  }
}

void add_general_options(CLI::App& verb, CommandLine& line) {
  verb.add_option("-c,--config", line.config_files,
                  "take settings from a TOML file, a run's folder or a preset; may be repeated")
      ->type_name("FILE|RUN|PRESET")
      ->expected(1)
      ->take_all()
      ->group("Settings");
  verb.add_option("--set", line.settings, "change one setting; wins over -c; may be repeated")
      ->type_name("SECTION.KEY=VALUE")
      ->expected(1)
      ->take_all()
      ->group("Settings");
  add_setting(verb, line, "--device", "train.device", "Machine",
              "where to compute; cuda:N is the GPU with that number");
  add_setting(verb, line, "--threads", "train.threads", "Machine");
  verb.add_flag("-q,--quiet", line.quiet, "print warnings and errors only")->group("Messages");
  verb.add_flag("-v,--verbose", line.verbose, "print more")->group("Messages");
}

void add_http_place(CLI::App& verb, HttpPlace& place, const std::string& prefix,
                    const std::string& group) {
  verb.add_option(prefix + "host", place.host,
                  "address to listen at [127.0.0.1: this machine only]")
      ->type_name("ADDRESS")
      ->group(group);
  verb.add_option(prefix + "port", place.port,
                  "port to listen at; 0: any free port [the first free one from 7070 on]")
      ->check(CLI::Range(0, 65535))
      ->type_name("N")
      ->group(group);
}

void add_time_option(CLI::App& verb, std::optional<double>& time, const std::string& help) {
  verb.add_option("--time", time, help)->type_name("T")->check(CLI::Range(0.0, 1.0));
}

void add_camera_options(CLI::App& verb, CommandLine& line, const std::string& scene_names) {
  add_setting(verb, line, scene_names, "dataset.source", "Scene");
  add_setting(verb, line, "--images", "dataset.images", "Scene");
  add_setting(verb, line, "-r,--resolution", "dataset.resolution", "Scene");
  add_setting(verb, line, "--test-every", "dataset.test_every", "Scene");
  add_foreign_flags(verb, line, "dataset.");
}

void add_mask_options(CLI::App& verb, CommandLine& line) {
  add_setting(verb, line, "--masks", "dataset.masks", "Scene");
  add_setting(verb, line, "--mask-mode", "dataset.mask_mode", "Scene");
  add_setting(verb, line, "--invert-masks", "dataset.invert_masks", "Scene");
}

void add_dataset_options(CLI::App& verb, CommandLine& line, const std::string& scene_names) {
  add_camera_options(verb, line, scene_names);
  add_mask_options(verb, line);
  add_setting(verb, line, "--depth", "dataset.depth", "Scene");
  add_setting(verb, line, "--depth-kind", "dataset.depth_kind", "Scene");
  add_setting(verb, line, "--photo-ram", "dataset.photo_ram_gib", "Machine");
  add_setting(verb, line, "--photo-cache", "dataset.photo_cache", "Machine");
}

void add_render_options(CLI::App& verb, CommandLine& line, const std::string& sh_degree_help) {
  add_setting(verb, line, "--background", "render.background", "Rendering");
  verb.add_flag_callback(
          "-w,--white-background", [&line] { line.flags.push_back("render.background=white"); },
          "the same as --background white")
      ->excludes("--background")
      ->group("Rendering");
  add_setting(verb, line, "--antialiased,--antialiasing", "render.antialias", "Rendering");
  add_setting(verb, line, "--blend-rule", "render.blend_rule", "Rendering");
  add_setting(verb, line, "--sh-degree", "model.sh_degree", "Rendering", sh_degree_help);
}

Config resolve(const CommandLine& line, Config start, SettingOrigins* origins) {
  SettingOrigins known;
  for (const std::string& file : line.config_files) load_config(start, file, &known);
  for (const std::string& setting : line.settings) known[apply_setting(start, setting)] = "--set";
  for (const std::string& flag : line.flags) known[apply_flag(start, flag)] = "flag";
  validate(start, known);
  if (origins) *origins = std::move(known);
  return start;
}

std::vector<std::filesystem::path> inputs_of(const CommandLine& line, const Config& config) {
  std::vector<std::filesystem::path> inputs = inputs_of(config);
  inputs.insert(inputs.end(), line.config_files.begin(), line.config_files.end());
  return inputs;
}

std::vector<std::string> normalized_arguments(int argc, const char* const* argv) {
  std::vector<std::string> arguments(argv + 1, argv + argc);
  for (std::string& argument : arguments) {
    if (!argument.starts_with("--")) continue;
    const auto end =
        argument.begin() + std::ptrdiff_t(std::min(argument.find('='), argument.size()));
    std::replace(argument.begin(), end, '_', '-');
  }
  return arguments;
}

}  // namespace gs
