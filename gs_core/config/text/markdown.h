// SPDX-License-Identifier: Apache-2.0
// Tables in Markdown.
#pragma once

#include <string>
#include <vector>

namespace gs {

/// "| a | b |" and a line end; a '|' in a cell is escaped.
inline std::string markdown_row(const std::vector<std::string>& cells) {
  std::string line = "|";
  for (const std::string& cell : cells) {
    line += ' ';
    for (const char c : cell) {
      if (c == '|') line += '\\';
      line += c;
    }
    line += " |";
  }
  return line + "\n";
}

/// The row of titles and the rule below it.
inline std::string markdown_header(const std::vector<std::string>& titles) {
  std::string rule = "|";
  for (std::size_t i = 0; i < titles.size(); ++i) rule += "---|";
  return markdown_row(titles) + rule + "\n";
}

}  // namespace gs
