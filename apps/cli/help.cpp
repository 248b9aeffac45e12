// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/help.h"

#include <spdlog/fmt/fmt.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <sstream>

namespace gs {
namespace {

constexpr std::size_t kNarrowest = 50, kWidest = 100;  // columns
// of an option's names, and of their further lines
constexpr std::size_t kNameIndent = 2, kMoreNames = 4;
constexpr std::size_t kColumn = 30;  // where meanings begin

constexpr const char* kHelpFlags[][2] = {{"-h,--help", "Print this help and exit"},
                                         {"--help-all", "Print all options and exit"}};

}  // namespace

std::size_t help_width() {
  winsize size{};
  if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return kWidest;
  return std::clamp<std::size_t>(size.ws_col, kNarrowest, kWidest);
}

std::string wrapped(const std::string& text, std::size_t start, std::size_t indent,
                    std::size_t width) {
  std::string result;
  std::size_t column = start;
  bool is_first = true;  // of its line
  const auto new_line = [&] {
    result += "\n" + std::string(indent, ' ');
    column = indent;
    is_first = true;
  };
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    if (!is_first && column + 1 + word.size() > width) new_line();
    while (column + word.size() > width && word.size() > 1) {  // longer than a line
      const std::size_t fits = std::max<std::size_t>(width - column, 1);
      const std::size_t mark = word.find_last_of(",|", fits - 1);
      const std::size_t cut = mark == word.npos ? fits : mark + 1;
      result += word.substr(0, cut);
      word.erase(0, cut);
      new_line();
    }
    result += (is_first ? "" : " ") + word;
    column += word.size() + (is_first ? 0 : 1);
    is_first = false;
  }
  return result;
}

namespace {

// The text stands beside the names if they fit into their column, and else below them.
std::string row(const std::string& name, const std::string& text, std::size_t width) {
  std::string result =
      std::string(kNameIndent, ' ') + wrapped(name, kNameIndent, kMoreNames, width);
  if (text.empty()) return result + "\n";
  if (result.size() + 1 > kColumn) {
    result += "\n" + std::string(kColumn, ' ');
  } else {
    result.resize(kColumn, ' ');
  }
  return result + wrapped(text, kColumn, kColumn, width) + "\n";
}

// "-o,--output FILE", "--open,--no-open".
std::string names_of(const Option& option) {
  std::string text;
  for (const std::string& name : option.names)
    if (!is_place(name)) text += (text.empty() ? "" : ",") + flag_of(name);
  const std::string value = option.shown_value();
  const bool is_open = option.takes_several() && !option.has_commas && !option.words;
  return text + (value.empty() ? "" : " " + value) + (is_open ? " ..." : "");
}

std::string place_of(const Option& option) {
  std::string name = option.names.front();
  std::transform(name.begin(), name.end(), name.begin(), ::toupper);
  name += option.takes_several() ? "..." : "";
  return option.is_required ? name : "[" + name + "]";
}

bool has_flag(const Option& option) {
  return !std::all_of(option.names.begin(), option.names.end(), is_place);
}

// The flag of a positional, as in `train -s SCENE`, says nothing new.
bool is_shown(const Option& option, bool all) {
  return has_flag(option) && !option.is_hidden &&
         (all || !(option.is_rare || option.is_positional()));
}

std::string usage(const std::string& name, const OptionList& list) {
  std::string text = "Usage: gemsplat " + name + " [OPTIONS]";
  for (const Option& option : list.options)
    if (option.is_positional()) text += " " + place_of(option);
  return text + (list.sub_verbs.empty() ? "" : " [SUBCOMMAND]") + "\n";
}

std::string positionals(const OptionList& list, std::size_t width) {
  std::string text;
  for (const Option& option : list.options) {
    if (!option.is_positional()) continue;
    const std::string value = option.shown_value();
    text += row(option.names.front() + (value.empty() ? "" : " " + value), option.meaning, width);
  }
  return text.empty() ? "" : "\nPositionals:\n" + text;
}

// The options that are shown, under their headings.
std::string options(const OptionList& list, bool all, std::size_t width) {
  std::vector<std::string> headings = {"Options"};
  for (const Option& option : list.options)
    if (std::find(headings.begin(), headings.end(), option.heading) == headings.end())
      headings.push_back(option.heading);
  std::string text;
  for (const std::string& heading : headings) {
    std::string rows;
    if (heading == headings.front())
      for (const auto& [name, meaning] : kHelpFlags) rows += row(name, meaning, width);
    for (const Option& option : list.options)
      if (option.heading == heading && is_shown(option, all))
        rows += row(names_of(option), option.meaning, width);
    if (!rows.empty()) text += "\n" + heading + ":\n" + rows;
  }
  return text;
}

std::string sub_verbs(const OptionList& list, std::size_t width) {
  std::string text;
  for (const SubVerb& verb : list.sub_verbs) text += row(verb.name, verb.meaning, width);
  return text.empty() ? "" : "\nSubcommands:\n" + text;
}

std::string left_out(const std::string& name, const OptionList& list) {
  const auto count = std::count_if(list.options.begin(), list.options.end(), [](const Option& o) {
    return is_shown(o, true) && !is_shown(o, false);
  });
  return count == 0 ? ""
                    : fmt::format("\n`gemsplat {} --help-all` shows {} more option{}\n", name,
                                  count, count == 1 ? "" : "s");
}

}  // namespace

std::string help_of_verb(const std::string& name, const std::string& meaning,
                         const OptionList& list, const std::vector<std::string>& examples, bool all,
                         std::size_t width) {
  std::string text = wrapped(meaning, 0, 0, width) + "\n" + usage(name, list) +
                     positionals(list, width) + options(list, all, width) + sub_verbs(list, width);
  if (!list.footer.empty()) text += "\n" + wrapped(list.footer_title + ":", 0, 0, width) + "\n";
  for (const auto& [word, meaning] : list.footer) text += row(word, meaning, width);
  if (!examples.empty()) text += "\nExamples:\n";
  for (const std::string& example : examples) text += "  gemsplat " + example + "\n";
  return text + (all ? "" : left_out(name, list));
}

std::string help_of_program(const std::vector<Verb>& verbs, std::size_t width) {
  std::string text =
      "3D Gaussian Splatting: from photos to a trained scene\n"
      "Usage: gemsplat COMMAND [OPTIONS], or gemsplat PHOTOS, which trains on them and shows it\n\n"
      "Options:\n";
  text += row(kHelpFlags[0][0], kHelpFlags[0][1], width) +
          row("-V,--version", "Print the version and exit", width);
  for (const VerbGroup group : {VerbGroup::train, VerbGroup::look, VerbGroup::change,
                                VerbGroup::compare, VerbGroup::check}) {
    text += fmt::format("\n{}:\n", heading_of(group));
    for (const Verb& verb : verbs)
      if (verb.group == group) text += row(verb.name, verb.meaning, width);
  }
  return text + "\n`gemsplat COMMAND --help` shows what a command takes\n";
}

}  // namespace gs
