// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/manual/reference_page.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

namespace gs {
namespace {

constexpr const char* kPageBegin = R"(# Commands

This page lists every command with all of its options. The program writes it from their lists in
[gs_app/jobs](../../gs_app/jobs) (`gemsplat self-doc --markdown`), and a test compares the two.
`gemsplat COMMAND --help` shows the options that most people need, `--help-all` all of them.
Options that name a setting are explained in [settings.md](settings.md).
)";

// Text in a cell of a table.
std::string cell(const std::string& text) { return replaced(text, "|", "\\|"); }

std::string cell_of_names(const Argument& argument) {
  std::string text;
  for (const std::string& name : argument.names) text += (text.empty() ? "" : ", ") + name;
  const bool has_value = argument.takes_value && !argument.placeholder.empty();
  return "`" + cell(text + (has_value ? " " + argument.placeholder : "")) + "`";
}

std::string rows(const Command& command) {
  std::string text = "| option | meaning |\n|---|---|\n";
  for (const bool is_positional : {true, false})
    for (const Argument& argument : command.arguments)
      if (argument.is_positional == is_positional)
        text += fmt::format("| {} | {} |\n", cell_of_names(argument), cell(argument.meaning));
  return text;
}

std::string section(const Command& command) {
  std::string text =
      fmt::format("\n### {}\n{}.\n\n```sh\n", command.joined_words(" "), command.meaning);
  for (const std::string& example : command.examples) text += "gemsplat " + example + "\n";
  if (command.examples.empty()) text = text.substr(0, text.size() - 6);
  text += (command.examples.empty() ? "" : "```\n\n") + rows(command);
  for (const Command& verb : command.verbs) text += section(verb);
  return text;
}

}  // namespace

std::string reference_page(const Command& program) {
  std::string text = kPageBegin;
  for (const VerbGroup group : {VerbGroup::train, VerbGroup::look, VerbGroup::change,
                                VerbGroup::compare, VerbGroup::check}) {
    text += fmt::format("\n## {}\n", heading_of(group));
    for (const Command& verb : program.verbs)
      if (std::string_view(verb.group) == heading_of(group)) text += section(verb);
  }
  return text;
}

}  // namespace gs
