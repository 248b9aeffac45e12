// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/csv.h"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <sstream>

#include "gs_core/error.h"
#include "gs_core/system/files/text_file.h"

namespace gs {

std::string csv_cell(const std::string& text) {
  if (text.find_first_of(",\"\n") == text.npos) return text;
  std::string result = "\"";
  for (const char c : text) result += c == '"' ? std::string("\"\"") : std::string(1, c);
  return result + "\"";
}

std::vector<std::string> csv_cells(std::string_view line) {
  std::vector<std::string> cells(1);
  bool is_quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (c == '"' && is_quoted && i + 1 < line.size() && line[i + 1] == '"') {
      cells.back() += line[++i];
    } else if (c == '"') {
      is_quoted = !is_quoted;
    } else if (c == ',' && !is_quoted) {
      cells.emplace_back();
    } else {
      cells.back() += c;
    }
  }
  return cells;
}

std::string csv_text(const std::filesystem::path& path) {
  constexpr std::uint64_t kMostBytes = 1 << 30;
  std::error_code ignored;
  return std::filesystem::exists(path, ignored) ? read_text_file(path, kMostBytes) : "";
}

std::string csv_rows_up_to(const std::filesystem::path& path, std::string_view header, int step) {
  std::istringstream file(csv_text(path));
  const std::size_t columns = csv_cells(header).size();
  std::string rows, line;
  for (std::getline(file, line); std::getline(file, line);) {
    const bool is_whole = !file.eof() && csv_cells(line).size() == columns;
    if (is_whole && std::atoi(line.c_str()) <= step) rows += line + "\n";
  }
  return rows;
}

int last_step_in(const std::filesystem::path& path) try {
  std::istringstream file(csv_text(path));
  int step = 0;
  std::string line;
  for (std::getline(file, line); std::getline(file, line) && !file.eof();)
    step = std::atoi(line.c_str());
  return step;
} catch (const Error&) {  // a run that goes on may have shortened it a moment ago
  return 0;
}

void append_rows(const std::filesystem::path& path, const std::string& rows) {
  std::ofstream file(path, std::ios::app);
  file << rows;
  if (!file.flush())
    throw Error("cannot write " + path.string() +
                ": free some space, or choose another folder with -o");
}

}  // namespace gs
