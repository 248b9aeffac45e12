// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/manual/command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <sstream>

#include "gs_core/config/config_presets.h"

namespace gs {
namespace {

// "auto|cpu" and "png,exr" name words to type; "FILE|RUN" and "0..1" name kinds of values.
bool is_word(const std::string& text) {
  return !text.empty() && std::islower(static_cast<unsigned char>(text.front())) &&
         std::all_of(text.begin(), text.end(), [](unsigned char c) {
           return std::islower(c) || std::isdigit(c) || c == '_' || c == '-';
         });
}

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::istringstream stream(text);
  for (std::string part; std::getline(stream, part, separator);) parts.push_back(part);
  return parts;
}

// The set of a check, as CLI11 shows it: "VERSION:{3,4}".
std::vector<std::string> checked_set(const std::string& type) {
  const std::size_t begin = type.find('{'), end = type.find('}');
  if (begin == type.npos || end == type.npos) return {};
  return split(type.substr(begin + 1, end - begin - 1), ',');
}

// The type without its check: "N" of "N:INT in [0 - 65535]". A colon can be part of it: "cuda:N".
std::string placeholder_of(const std::string& type) {
  std::size_t end = type.size();
  for (const char* check : {":{", ":INT ", ":UINT ", ":FLOAT ", ":POSITIVE", ":NONNEGATIVE"})
    end = std::min(end, type.find(check));
  std::string text = type.substr(0, end);
  if (!text.starts_with('{')) return text;
  return replaced(text.substr(1, text.find('}') - 1), ",", "|");
}

std::vector<std::string> choices_of(const std::string& type) {
  if (const std::vector<std::string> set = checked_set(type); !set.empty()) return set;
  std::vector<std::string> words;
  for (const char separator : {'|', ','}) {
    const std::vector<std::string> parts = split(type, separator);
    if (parts.size() < 2) continue;
    std::copy_if(parts.begin(), parts.end(), std::back_inserter(words), is_word);
    break;
  }
  if (type.find("PRESET") != type.npos)
    for (const Preset& preset : presets()) words.emplace_back(preset.name);
  return words;
}

Argument read_argument(const CLI::Option& option, bool as_positional) {
  Argument argument;
  argument.is_positional = as_positional;
  argument.is_required = option.get_required();
  argument.takes_value = option.get_items_expected_max() > 0;
  argument.takes_several = option.get_items_expected_max() > 1;
  argument.meaning = option.get_description();
  argument.group = option.get_group();
  if (as_positional) {
    argument.names.push_back(option.get_name(true));
  } else {
    for (const std::string& name : option.get_snames()) argument.names.push_back("-" + name);
    for (const std::string& name : option.get_lnames()) argument.names.push_back("--" + name);
  }
  if (!argument.takes_value) return argument;
  const std::string type = option.get_type_name();
  argument.choices = choices_of(type);
  argument.placeholder = placeholder_of(type);
  return argument;
}

Command read_below(const CLI::App& app, std::vector<std::string> words) {
  Command command;
  command.words = std::move(words);
  command.words.push_back(app.get_name());
  command.meaning = app.get_description();
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_group().empty()) continue;
    // One option can be both: `train SCENE` and `train -s SCENE`.
    if (option->get_positional()) command.arguments.push_back(read_argument(*option, true));
    if (!option->get_snames().empty() || !option->get_lnames().empty())
      command.arguments.push_back(read_argument(*option, false));
  }
  for (const CLI::App* verb : app.get_subcommands({}))
    if (!verb->get_group().empty()) command.verbs.push_back(read_below(*verb, command.words));
  return command;
}

}  // namespace

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (std::size_t at = text.find(from); at != text.npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
  return text;
}

bool Argument::takes_folders() const { return placeholder == "FOLDER"; }

bool Argument::takes_files() const {
  for (const char* kind : {"FILE", "FOLDER", "MODEL", "RUN", "EXPERIMENT", "FILM", "PHOTO"})
    if (placeholder.find(kind) != placeholder.npos) return true;
  return is_positional && takes_value && choices.empty();
}

bool Command::takes_positional_files() const {
  return std::any_of(arguments.begin(), arguments.end(), [](const Argument& argument) {
    return argument.is_positional && argument.takes_files();
  });
}

std::string Command::joined_words(const std::string& separator) const {
  std::string text = words.front();
  for (std::size_t i = 1; i < words.size(); ++i) text += separator + words[i];
  return text;
}

Command read_command(const CLI::App& app) { return read_below(app, {}); }

}  // namespace gs
