// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include "apps/cli/manual/completions.h"

namespace gs {
namespace {

std::string fish_quoted(const std::string& text) {
  return "'" + replaced(replaced(text, "\\", "\\\\"), "'", "\\'") + "'";
}

// The condition under which a verb's words are offered.
std::string condition(const Command& command) {
  if (command.words.size() == 1) return "__fish_use_subcommand";
  return "__fish_seen_subcommand_from " + command.name();
}

std::string value_flags(const Argument& argument) {
  std::string text = argument.takes_files() ? " -r -F" : " -x";
  if (!argument.choices.empty())
    text += fmt::format(" -a {}", fish_quoted(fmt::format("{}", fmt::join(argument.choices, " "))));
  return text;
}

std::string names_of(const Argument& argument) {
  std::string text;
  for (const std::string& name : argument.names)
    text += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
  return text;
}

std::string lines(const Command& command) {
  const std::string begin = "complete -c gemsplat -n " + fish_quoted(condition(command));
  std::string text;
  for (const Command& verb : command.verbs)
    text += fmt::format("{} -f -a {} -d {}\n", begin, verb.name(), fish_quoted(verb.meaning));
  for (const Argument& argument : command.arguments)
    if (!argument.is_positional)
      text += begin + names_of(argument) + (argument.takes_value ? value_flags(argument) : "") +
              " -d " + fish_quoted(argument.meaning) + "\n";
  for (const Command& verb : command.verbs) text += lines(verb);
  return text;
}

}  // namespace

std::string fish_completion(const Command& program) {
  return "# Completion of gemsplat for fish; written by `gemsplat self-doc`.\n" + lines(program);
}

}  // namespace gs
