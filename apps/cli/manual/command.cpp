// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/manual/command.h"

#include <algorithm>

#include "apps/cli/run_verb.h"

namespace gs {
namespace {

Argument flag(std::vector<std::string> names, std::string meaning, std::string group) {
  Argument argument;
  argument.names = std::move(names);
  argument.meaning = std::move(meaning);
  argument.group = std::move(group);
  return argument;
}

Argument argument_of(const Option& option, bool as_positional) {
  Argument argument = flag({}, option.meaning, option.heading);
  argument.is_positional = as_positional;
  argument.is_required = option.is_required;
  argument.takes_value = !option.is_flag();
  argument.takes_several = option.takes_several();
  for (const std::string& name : option.names)
    if (is_place(name) == as_positional) argument.names.push_back(flag_of(name));
  if (!argument.takes_value) return argument;
  argument.choices = option.choices.empty() ? option.suggested : option.choices;
  argument.placeholder = option.shown_value();
  return argument;
}

void add_arguments(Command& command, const OptionList& list) {
  for (const Option& option : list.options) {
    if (option.is_hidden) continue;
    // One option can be both: `train SCENE` and `train -s SCENE`.
    for (const bool as_positional : {true, false}) {
      Argument argument = argument_of(option, as_positional);
      if (!argument.names.empty()) command.arguments.push_back(std::move(argument));
    }
  }
  for (const SubVerb& verb : list.sub_verbs) {
    Command& sub = command.verbs.emplace_back();
    sub.words = command.words;
    sub.words.push_back(verb.name);
    sub.meaning = verb.meaning;
    sub.arguments.push_back(flag({"-h", "--help"}, "Print this help and exit", "Options"));
    add_arguments(sub, verb.options);
  }
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

Command command_of(const std::vector<Verb>& verbs) {
  Command program;
  program.words = {"gemsplat"};
  program.meaning = "3D Gaussian Splatting: from photos to a trained scene";
  program.arguments = {flag({"-h", "--help"}, "Print this help and exit", "Options"),
                       flag({"-V", "--version"}, "Print the version and exit", "Options")};
  for (const Verb& verb : verbs) {
    Command& command = program.verbs.emplace_back();
    command.words = {"gemsplat", verb.name};
    command.meaning = verb.meaning;
    command.examples = verb.examples;
    command.group = heading_of(verb.group);
    command.arguments = {flag({"-h", "--help"}, "Print this help and exit", "Options"),
                         flag({"--help-all"}, "Print all options and exit", "Options")};
    BoundVerb bound{verb, verb.call()};
    add_common_options(bound);
    add_arguments(command, bound.call->options());
  }
  return program;
}

}  // namespace gs
