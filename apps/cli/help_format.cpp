// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/help_format.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <sstream>

namespace gs {
namespace {

constexpr std::size_t kNarrowest = 50, kWidest = 100;  // columns
// of an option's names, and of their further lines
constexpr std::size_t kNameIndent = 2, kMoreNames = 4;

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

// The text stands beside the names if they fit into their column, and else below them.
std::string HelpFormat::row(const std::string& name, const std::string& text) const {
  const std::size_t column = get_column_width();
  std::string result =
      std::string(kNameIndent, ' ') + wrapped(name, kNameIndent, kMoreNames, width_);
  if (text.empty()) return result + "\n";
  if (result.size() + 1 > column) {
    result += "\n" + std::string(column, ' ');
  } else {
    result.resize(column, ' ');
  }
  return result + wrapped(text, column, column, width_) + "\n";
}

std::string HelpFormat::make_option(const CLI::Option* option, bool is_positional) const {
  return row(make_option_name(option, is_positional) + make_option_opts(option),
             make_option_desc(option));
}

std::string HelpFormat::make_subcommand(const CLI::App* verb) const {
  return row(verb->get_display_name(true), verb->get_description());
}

std::string HelpFormat::make_description(const CLI::App* app) const {
  return wrapped(app->get_description(), 0, 0, width_) + "\n";
}

}  // namespace gs
