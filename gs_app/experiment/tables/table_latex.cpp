// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/table_latex.h"

#include <spdlog/fmt/fmt.h>

#include <string_view>

namespace gs {
namespace {

std::string escaped(std::string_view text) {
  std::string result;
  for (const char c : text) {
    if (std::string_view("&%$#_{}").find(c) != std::string_view::npos)
      result += fmt::format("\\{}", c);
    else if (c == '\\')
      result += "\\textbackslash{}";
    else if (c == '~' || c == '^')
      result += fmt::format("\\{}{{}}", c);
    else
      result += c;
  }
  return result;
}

void replace_all(std::string& text, std::string_view from, std::string_view to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != text.npos; at += to.size())
    text.replace(at, from.size(), to);
}

// "1,234 ± 5" as "$1{,}234 \pm 5$"
std::string number(std::string cell) {
  if (cell == "-") return "--";
  replace_all(cell, ",", "{,}");
  replace_all(cell, "±", "\\pm");
  return "$" + cell + "$";
}

std::string row_of(const std::vector<std::string>& cells) {
  return fmt::format("    {} \\\\\n", fmt::join(cells, " & "));
}

std::string table_text(const TextTable& table, const std::string& caption) {
  std::string columns(table.names, 'l'), body;
  columns.append(table.titles.size() - table.names, 'r');
  std::vector<std::string> titles;
  for (const std::string& title : table.titles) titles.push_back(escaped(title));
  for (const std::vector<std::string>& row : table.rows) {
    std::vector<std::string> cells;
    for (std::size_t c = 0; c < row.size(); ++c)
      cells.push_back(c < table.names ? escaped(row[c]) : number(row[c]));
    body += row_of(cells);
  }
  return fmt::format(
      "\n\\begin{{table}}\n  \\centering\n  \\caption{{{}}}\n  \\begin{{tabular}}{{{}}}\n"
      "    \\toprule\n{}    \\midrule\n{}    \\bottomrule\n  \\end{{tabular}}\n\\end{{table}}\n",
      caption, columns, row_of(titles), body);
}

}  // namespace

std::string experiment_latex(const std::string& title, const PaperTables& tables) {
  std::string name = title;  // on a line of its own, whatever the file is called
  for (char& c : name)
    if (static_cast<unsigned char>(c) < ' ') c = ' ';
  std::string text = fmt::format("% {}\n% \\usepackage{{booktabs}} in the preamble\n", name);
  text += table_text(tables.means, "Means $\\pm$ standard deviations over seeds.");
  if (!tables.scene_means.rows.empty())
    text += table_text(tables.scene_means,
                       "Means over scenes; means $\\pm$ standard deviations over seeds.");
  if (!tables.differences.rows.empty())
    text += table_text(
        tables.differences,
        fmt::format("Differences to {}, paired by scene and seed; means $\\pm$ standard errors.",
                    escaped(tables.baseline)));
  return text;
}

}  // namespace gs
