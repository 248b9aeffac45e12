// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/manual/man_page.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/system/version.h"

namespace gs {
namespace {

// Text that roff shows as it is: backslashes and dashes are escaped, and no line begins with a dot.
std::string plain(const std::string& text) {
  std::string result = replaced(replaced(text, "\\", "\\e"), "-", "\\-");
  if (result.starts_with('.') || result.starts_with('\'')) result.insert(0, "\\&");
  return result;
}

std::string upper(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), ::toupper);
  return text;
}

// "\fB\-o\fR, \fB\-\-output\fR \fIFOLDER\fR"
std::string heading(const Argument& argument) {
  std::string names;
  for (const std::string& name : argument.names)
    names += (names.empty() ? "" : ", ") + fmt::format("\\fB{}\\fR", plain(name));
  if (argument.is_positional) names = fmt::format("\\fI{}\\fR", plain(argument.names.front()));
  const bool has_placeholder = argument.takes_value && !argument.placeholder.empty();
  if (has_placeholder) names += fmt::format(" \\fI{}\\fR", plain(argument.placeholder));
  return names + (argument.takes_several ? " ..." : "");
}

std::string paragraph(const Argument& argument) {
  std::string meaning = argument.meaning;
  if (meaning.empty()) meaning = "no description";
  return ".TP\n" + heading(argument) + "\n" + plain(meaning) + "\n";
}

// The arguments of one heading of --help, under that heading.
std::string section(const Command& command, const std::string& group) {
  std::string text;
  for (const Argument& argument : command.arguments)
    if (!argument.is_positional && argument.group == group) text += paragraph(argument);
  return text.empty() ? "" : fmt::format(".SS {}\n", plain(group)) + text;
}

std::string options(const Command& command) {
  std::vector<std::string> groups;
  for (const Argument& argument : command.arguments)
    if (std::find(groups.begin(), groups.end(), argument.group) == groups.end())
      groups.push_back(argument.group);
  std::string text;
  for (const std::string& group : groups) text += section(command, group);
  return text.empty() ? "" : ".SH OPTIONS\n" + text;
}

std::string positionals(const Command& command) {
  std::string text;
  for (const Argument& argument : command.arguments)
    if (argument.is_positional) text += paragraph(argument);
  return text.empty() ? "" : ".SH ARGUMENTS\n" + text;
}

std::string synopsis(const Command& command) {
  std::string text = fmt::format(".B {}\n[\\fIoptions\\fR]", plain(command.joined_words(" ")));
  if (!command.verbs.empty()) text += command.words.size() == 1 ? " \\fIcommand\\fR" : "";
  for (const Argument& argument : command.arguments) {
    if (!argument.is_positional) continue;
    const std::string name = fmt::format("\\fI{}\\fR", plain(argument.names.front())) +
                             (argument.takes_several ? " ..." : "");
    text += argument.is_required ? " " + name : " [" + name + "]";
  }
  return ".SH SYNOPSIS\n" + text + "\n";
}

std::string verbs(const Command& command) {
  std::string text;
  for (const Command& verb : command.verbs)
    text += fmt::format(".TP\n.B {}\n{}\n", plain(verb.name()), plain(verb.meaning));
  return text.empty() ? "" : ".SH COMMANDS\n" + text;
}

std::string examples(const Command& command) {
  std::string text;
  for (const std::string& example : command.examples)
    text += (text.empty() ? "" : ".br\n") + fmt::format("gemsplat {}\n", plain(example));
  return text.empty() ? "" : ".SH EXAMPLES\n" + text;
}

// Of a page's own verbs below, or of the program's page for a verb.
std::string see_also(const Command& command) {
  std::vector<std::string> pages;
  for (const Command& verb : command.verbs) pages.push_back(verb.joined_words("-"));
  if (command.words.size() > 1) pages.push_back(command.words.front());
  std::string text;
  for (std::size_t i = 0; i < pages.size(); ++i)
    text += fmt::format(".BR {} (1){}\n", plain(pages[i]), i + 1 < pages.size() ? "," : "");
  return text.empty() ? "" : ".SH SEE ALSO\n" + text;
}

}  // namespace

std::string man_page(const Command& command, const std::string& date) {
  const std::string name = command.joined_words("-");
  return fmt::format(".TH {} 1 {} \"gemsplat {}\" \"gemsplat\"\n", plain(upper(name)), date,
                     kVersion) +
         fmt::format(".SH NAME\n{} \\- {}\n", plain(name), plain(command.meaning)) +
         synopsis(command) + positionals(command) + verbs(command) + options(command) +
         examples(command) + see_also(command);
}

}  // namespace gs
