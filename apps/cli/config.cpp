// SPDX-License-Identifier: Apache-2.0
// gemsplat config: prints, explains and compares settings, and lists the presets.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <memory>

#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "gs_core/config/config_presets.h"
#include "gs_core/config/config_table.h"

namespace gs {
namespace {

struct ConfigCommand : CommandLine {
  bool list = false, markdown = false;
  std::vector<std::string> explained;
  std::string a, b;  // of `diff`
  CLI::App *explain = nullptr, *diff = nullptr;
};

void list_presets() {
  std::size_t width = 0;
  for (const Preset& preset : presets()) width = std::max(width, preset.name.size());
  for (const Preset& preset : presets())
    std::cout << fmt::format("{:<{}} {}\n", preset.name, width, summary(preset));
}

void explain_settings(const ConfigCommand& command) {
  SettingOrigins origins;
  const Config config = resolve(command, {}, &origins);
  if (command.explained.empty()) std::cout << explain(config, origins, "");
  for (const std::string& key : command.explained) std::cout << explain(config, origins, key);
}

// Compares two configs, or one with the defaults. -c and --set apply to both.
void compare(const ConfigCommand& command) {
  SettingOrigins a_origins, b_origins;
  Config a = resolve(command, {}, &a_origins), b = resolve(command, {}, &b_origins);
  if (!command.b.empty()) load_config(a, command.a, &a_origins);
  load_config(b, command.b.empty() ? command.a : command.b, &b_origins);
  const std::string text = difference(a, a_origins, b, b_origins);
  std::cout << (text.empty() ? "no setting differs\n" : text);
}

void config(const ConfigCommand& command) {
  if (command.list) return list_presets();
  if (command.markdown) {
    std::cout << config_markdown();
  } else if (command.explain->parsed()) {
    explain_settings(command);
  } else if (command.diff->parsed()) {
    compare(command);
  } else {
    std::cout << to_toml(resolve(command));
  }
}

}  // namespace

void add_config(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand(
      "config", "Print, explain and compare settings; without a verb, print all of them as TOML");
  const auto command = std::make_shared<ConfigCommand>();
  add_general_options(verb, *command);
  verb.add_flag("--list", command->list, "list the presets, and do nothing else");
  verb.add_flag("--markdown", command->markdown,
                "print docs/reference/settings.md, and do nothing else");

  command->explain = verb.add_subcommand(
      "explain", "Print meaning, unit, range, default, source and origin of settings");
  command->explain->fallthrough();
  command->explain
      ->add_option("keys", command->explained, "section.key, or a section [all settings]")
      ->type_name("KEY");
  command->diff = verb.add_subcommand("diff", "Print the settings that differ between two configs");
  command->diff->fallthrough();
  command->diff->add_option("a", command->a, "a TOML file, a run's folder or a preset")
      ->type_name("A")
      ->required();
  command->diff->add_option("b", command->b, "another one [none: compare A with the defaults]")
      ->type_name("B");
  verb.callback([command] { config(*command); });
}

}  // namespace gs
