// SPDX-License-Identifier: Apache-2.0
// What the program takes on its command line, from the lists of its verbs: the one source of man
// pages, completions and the page of commands.
#pragma once

#include <string>
#include <vector>

#include "gs_app/jobs/parts/job.h"

namespace gs {

/// A flag, an option with a value, or a positional.
struct Argument {
  std::vector<std::string> names;    // "-o", "--output"; a positional has one, without dashes
  std::string placeholder;           // of its value: "FOLDER"; empty for a flag
  std::vector<std::string> choices;  // all words that the value can be; empty where others are, too
  std::string meaning;               // the text of --help
  std::string group;                 // the heading in --help
  bool is_positional = false, takes_value = false, is_required = false;
  bool takes_several = false;  // values at once

  bool takes_files() const;    // a file or a folder
  bool takes_folders() const;  // a folder alone
};

/// The program or a verb, with all that --help shows.
struct Command {
  std::vector<std::string> words;  // "gemsplat", "config", "diff"
  std::string meaning;
  std::vector<Argument> arguments;
  std::vector<Command> verbs;
  std::vector<std::string> examples;
  const char* group = "";  // the heading of a verb in --help

  const std::string& name() const { return words.back(); }
  std::string joined_words(const std::string& separator) const;
  bool takes_positional_files() const;
};

/// The program with all verbs. Arguments that --help-all hides are left out.
Command command_of(const std::vector<Verb>& verbs);

/// `from` is replaced by `to` everywhere; for the quoting of shells.
std::string replaced(std::string text, const std::string& from, const std::string& to);

}  // namespace gs
