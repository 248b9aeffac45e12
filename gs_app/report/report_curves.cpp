// SPDX-License-Identifier: Apache-2.0
#include "gs_app/report/report_curves.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <sstream>

#include "gs_app/run/csv.h"
#include "gs_core/error.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

using Row = std::vector<std::string>;

constexpr const char* kStep = "step";            // the first column of both files
constexpr const char* kEvaluated = "test_psnr";  // has a value in rows with an evaluation
const Row kProfileHeader = {kStep, "quantity", "name", "value"};

/// A file of comma-separated values. Its header is empty if there is no file.
struct Table {
  Row header;
  std::vector<Row> rows;
};

// Of each name once, with the steps first.
bool is_header(Row names) {
  if (names.front() != kStep) return false;
  std::sort(names.begin(), names.end());
  return std::adjacent_find(names.begin(), names.end()) == names.end();
}

[[noreturn]] void fail_by_header(const std::filesystem::path& path) {
  throw Error(
      fmt::format("cannot read {}: its first line is damaged; move the file away for a "
                  "report without its curves",
                  path.string()));
}

[[noreturn]] void fail(const std::filesystem::path& path, std::size_t line) {
  throw Error(
      fmt::format("cannot read {}: line {} is damaged; delete that line, or move the file away "
                  "for a report without its curves",
                  path.string(), line));
}

Table read_table(const std::filesystem::path& path) {
  Table table;
  std::istringstream file(csv_text(path));
  std::string line;
  if (!std::getline(file, line)) return table;
  table.header = csv_cells(line);
  if (!is_header(table.header)) fail_by_header(path);
  for (std::size_t number = 2; std::getline(file, line); ++number) {
    if (file.eof()) break;  // a kill has cut this row short
    table.rows.push_back(csv_cells(line));
    if (table.rows.back().size() != table.header.size()) fail(path, number);
  }
  return table;
}

// Null for an empty cell and for a number that is not finite.
Json number(const std::filesystem::path& path, std::size_t row, const std::string& cell) {
  if (cell.empty()) return nullptr;
  double value = 0;
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
  if (error != std::errc() || end != cell.data() + cell.size()) fail(path, row + 2);
  if (!std::isfinite(value)) return nullptr;
  if (value == std::floor(value) && std::abs(value) < 1e15) return std::int64_t(value);
  return value;
}

std::size_t stride_for(std::size_t count, std::size_t most) {
  return std::max<std::size_t>(1, (count + most - 1) / most);
}

}  // namespace

Json metrics_columns(const std::filesystem::path& path, std::size_t most) {
  const auto [header, rows] = read_table(path);
  const std::size_t stride = stride_for(rows.size(), most);
  const auto evaluated =
      std::size_t(std::find(header.begin(), header.end(), kEvaluated) - header.begin());
  Json columns = {{kStep, Json::array()}};
  for (const std::string& name : header) columns[name] = Json::array();
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const bool is_evaluated = evaluated < header.size() && !rows[i][evaluated].empty();
    if (i % stride != 0 && i + 1 != rows.size() && !is_evaluated) continue;
    for (std::size_t c = 0; c < header.size(); ++c)
      columns[header[c]].push_back(number(path, i, rows[i][c]));
  }
  return columns;
}

Json profile_columns(const std::filesystem::path& path, std::size_t most) {
  const auto [header, rows] = read_table(path);
  if (!header.empty() && header != kProfileHeader) fail_by_header(path);
  std::vector<std::string> names;                             // of stages, in order of first use
  std::map<int, std::map<std::string, Json>> stages, memory;  // by step
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Json step = number(path, i, rows[i][0]);
    if (!step.is_number_integer()) fail(path, i + 2);
    const std::string& name = rows[i][2];
    const bool is_stage = rows[i][1] == "stage_ms";
    if (is_stage && std::find(names.begin(), names.end(), name) == names.end())
      names.push_back(name);
    (is_stage ? stages : memory)[step.get<int>()][name] = number(path, i, rows[i][3]);
  }
  const auto columns = [&](const auto& by_step, const std::vector<std::string>& of) {
    Json steps = Json::array(), lists = Json::array();
    for (std::size_t c = 0; c < of.size(); ++c) lists.push_back(Json::array());
    const std::size_t stride = stride_for(by_step.size(), most);
    std::size_t i = 0;
    for (const auto& [step, values] : by_step) {
      if (i++ % stride != 0) continue;
      steps.push_back(step);
      for (std::size_t c = 0; c < of.size(); ++c)
        lists[c].push_back(values.contains(of[c]) ? values.at(of[c]) : Json(nullptr));
    }
    return std::pair(steps, lists);
  };
  Json result = Json::object();
  if (!stages.empty()) {
    const auto [steps, lists] = columns(stages, names);
    result["stages"] = {{"step", steps}, {"names", names}, {"milliseconds", lists}};
  }
  if (!memory.empty()) {
    const auto [steps, lists] = columns(memory, {"host", "gpu"});
    result["memory"] = {{"step", steps}, {"host", lists[0]}, {"gpu", lists[1]}};
  }
  return result;
}

}  // namespace gs
