// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include "apps/cli/manual/completions.h"

namespace gs {
namespace {

// Text between single quotes, in which _arguments gives colons and brackets a meaning.
std::string zsh_quoted(std::string text) {
  for (const char* special : {"\\", ":", "[", "]"})
    text = replaced(text, special, std::string("\\") + special);
  return replaced(text, "'", "'\\''");
}

// "_gemsplat_config_diff"
std::string function_of(const Command& command) {
  return "_" + replaced(command.joined_words("_"), "-", "_");
}

// What completes the value of an argument: "FOLDER:_files -/", "VERSION:(3 4)".
std::string value_of(const Argument& argument) {
  const std::string name =
      argument.placeholder.empty() ? argument.names.front() : argument.placeholder;
  const std::string words = fmt::format("({})", fmt::join(argument.choices, " "));
  std::string action = argument.choices.empty() ? " " : words;
  if (argument.takes_files()) {
    const std::string files = argument.takes_folders() ? "_files -/" : "_files";
    action = argument.choices.empty()
                 ? files
                 : fmt::format("_alternative \"words:word:{}\" \"files:file:{}\"", words, files);
  }
  return zsh_quoted(name) + ":" + action;
}

// One line of _arguments. An option may be given again: "*".
std::string specification(const Argument& argument) {
  if (argument.is_positional)
    return fmt::format("    '{}:{}'\n", argument.takes_several ? "*" : "", value_of(argument));
  const std::string names = argument.names.size() == 1
                                ? "'" + argument.names.front() + "'"
                                : fmt::format("{{{}}}", fmt::join(argument.names, ","));
  const std::string value = argument.takes_value ? ":" + value_of(argument) : "";
  return fmt::format("    '*'{}'[{}]{}'\n", names, zsh_quoted(argument.meaning), value);
}

std::string describe_verbs(const Command& command) {
  std::string text = "  local -a verbs=(\n";
  for (const Command& verb : command.verbs)
    text += fmt::format("    '{}:{}'\n", verb.name(), zsh_quoted(verb.meaning));
  return text + "  )\n";
}

std::string dispatch(const Command& command) {
  std::string text =
      "  case $state in\n    verb) _describe verb verbs ;;\n    rest)\n"
      "      case $line[1] in\n";
  for (const Command& verb : command.verbs)
    text += fmt::format("        {}) {} ;;\n", verb.name(), function_of(verb));
  return text + "      esac ;;\n  esac\n";
}

std::string function(const Command& command) {
  std::string specifications, others;
  for (const Argument& argument : command.arguments) specifications += specification(argument);
  if (!command.verbs.empty()) specifications += "    '1: :->verb'\n    '*:: :->rest'\n";
  for (const Command& verb : command.verbs) others += function(verb);
  return others + function_of(command) + "() {\n  local state line\n  typeset -A opt_args\n" +
         (command.verbs.empty() ? "" : describe_verbs(command)) + "  local -a arguments=(\n" +
         specifications + "  )\n  _arguments -C $arguments\n" +
         (command.verbs.empty() ? "" : dispatch(command)) + "}\n\n";
}

}  // namespace

std::string zsh_completion(const Command& program) {
  return "#compdef gemsplat\n# Completion of gemsplat for zsh; written by `gemsplat "
         "self-doc`.\n\n" +
         function(program) + "_gemsplat \"$@\"\n";
}

}  // namespace gs
