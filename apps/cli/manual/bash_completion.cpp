// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include "apps/cli/manual/completions.h"

namespace gs {
namespace {

constexpr const char* kBegin = R"(# Completion of gemsplat for bash; written by `gemsplat self-doc`.
_gemsplat() {
  local current=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]}
  local words='' flags='' values='' files='' verb='' word
  COMPREPLY=()
  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do
    case "$verb $word" in
      )";

constexpr const char* kEnd = R"(  esac
  if [[ $values == none ]]; then
    return
  elif [[ -n $values ]]; then
    words=$values flags='' files=''
  fi
  if [[ $current == -* && -n $flags ]]; then
    COMPREPLY=($(compgen -W "$flags" -- "$current"))
    return
  fi
  COMPREPLY=($(compgen -W "$words" -- "$current"))
  if [[ -n $files ]]; then
    compopt -o filenames 2>/dev/null
    local IFS=$'\n'
    COMPREPLY+=($(compgen "$files" -- "$current"))
  fi
}
complete -F _gemsplat gemsplat
)";

// What the loop over the words before knows a verb by: " config diff".
std::string path_of(const Command& command) {
  std::string path;
  for (std::size_t i = 1; i < command.words.size(); ++i) path += " " + command.words[i];
  return path;
}

std::string paths_below(const Command& command) {
  std::string text;
  for (const Command& verb : command.verbs)
    text += (text.empty() ? "'" : " | '") + path_of(verb) + "'" +
            (verb.verbs.empty() ? "" : " | " + paths_below(verb));
  return text;
}

std::string joined(const std::vector<std::string>& words, const char* separator) {
  return fmt::format("{}", fmt::join(words, separator));
}

// Sets what may follow an option with a value: words, files, or nothing that is known.
std::string value_case(const Argument& argument) {
  std::string action = fmt::format("values='{}'", joined(argument.choices, " "));
  if (argument.takes_files()) {
    const char* kind = argument.takes_folders() ? "-d" : "-f";
    action = fmt::format("words='{}' flags='' files={}", joined(argument.choices, " "), kind);
  } else if (argument.choices.empty()) {
    action = "values=none";
  }
  return fmt::format("        {}) {} ;;\n", joined(argument.names, " | "), action);
}

std::string verb_case(const Command& command) {
  std::string flags, cases, words;
  for (const Command& verb : command.verbs) words += (words.empty() ? "" : " ") + verb.name();
  for (const Argument& argument : command.arguments) {
    if (argument.is_positional) continue;
    flags += (flags.empty() ? "" : " ") + joined(argument.names, " ");
    if (argument.takes_value) cases += value_case(argument);
  }
  std::string text =
      fmt::format("    '{}')\n      words='{}' flags='{}'\n", path_of(command), words, flags);
  if (command.takes_positional_files()) text += "      files=-f\n";
  if (!cases.empty()) text += "      case $before in\n" + cases + "      esac\n";
  text += "      ;;\n";
  for (const Command& verb : command.verbs) text += verb_case(verb);
  return text;
}

}  // namespace

std::string bash_completion(const Command& program) {
  return kBegin + paths_below(program) +
         ") verb=\"$verb $word\" ;;\n    esac\n  done\n  case $verb in\n" + verb_case(program) +
         kEnd;
}

}  // namespace gs
