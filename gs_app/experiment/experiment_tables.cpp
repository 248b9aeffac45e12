// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/experiment_tables.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>

#include "gs_app/run/csv.h"
#include "gs_app/run/provenance.h"
#include "gs_app/run/text.h"
#include "gs_core/config/config_diff.h"
#include "gs_core/config/markdown.h"
#include "gs_core/version.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kMiB = 1 << 20;

/// A figure of which mean and standard deviation are taken.
struct Metric {
  const char *key, *title;
  bool of_views;  // in results.json under "test", or "train" where nothing was held out
  double unit;    // of the Markdown table, in which the title stands
  int digits;
};
constexpr Metric kMetrics[] = {
    {"psnr", "PSNR / dB", true, 1, 2},
    {"ssim", "SSIM", true, 1, 4},
    {"lpips", "LPIPS", true, 1, 4},
    {"num_gaussians", "Gaussians", false, 1, 0},
    {"train_seconds", "training / s", false, 1, 1},
    {"peak_host_bytes", "memory / MiB", false, kMiB, 0},
    {"peak_gpu_bytes", "GPU memory / MiB", false, kMiB, 0},
};
constexpr const char* kProvenance[] = {"iterations", "device",  "cpu",    "driver",
                                       "scene_hash", "version", "commit", "date"};

struct Row {
  const ExperimentRun* run;
  std::string state;
  Json results;  // null where there are none
};

std::optional<double> value_of(const Row& row, const Metric& metric) {
  if (row.results.is_null()) return std::nullopt;
  const Json* holder = &row.results;
  if (metric.of_views) {
    const bool has_test = row.results.contains("test") && row.results["test"].is_object();
    const char* split = has_test ? "test" : "train";
    if (!row.results.contains(split)) return std::nullopt;
    holder = &row.results.at(split);
  }
  if (!holder->is_object() || !holder->contains(metric.key) || !holder->at(metric.key).is_number())
    return std::nullopt;
  return holder->at(metric.key).get<double>();
}

// Of the scene's results, where a file can be read; a damaged one is no result.
Json read_results(const ExperimentRun& run) {
  std::ifstream file(run.folder.results());
  const Json json = Json::parse(file, nullptr, false);
  return json.is_object() ? json : Json(nullptr);
}

std::vector<Row> rows_of(const std::vector<ExperimentRun>& runs,
                         const std::vector<std::size_t>& failed) {
  std::vector<Row> rows;
  for (const ExperimentRun& run : runs) {
    Row row{&run, "missing", nullptr};
    if (is_finished(run)) row.results = read_results(run);
    if (!row.results.is_null()) {
      row.state = "finished";
    } else if (std::find(failed.begin(), failed.end(), run.index) != failed.end()) {
      row.state = "failed";
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

// ---- means over seeds -----------------------------------------------------------------------------------

struct Spread {
  double mean = 0;
  std::optional<double> deviation;  // of two and more
};

struct Group {
  std::string scene, config;
  std::vector<const Row*> rows;  // finished ones
  std::size_t wanted = 0;

  std::optional<Spread> spread(const Metric& metric) const {
    std::vector<double> values;
    for (const Row* row : rows)
      if (const auto value = value_of(*row, metric)) values.push_back(*value);
    if (values.empty()) return std::nullopt;
    Spread spread;
    for (const double value : values) spread.mean += value / double(values.size());
    if (values.size() < 2) return spread;
    double squares = 0;
    for (const double value : values) squares += (value - spread.mean) * (value - spread.mean);
    spread.deviation = std::sqrt(squares / double(values.size() - 1));
    return spread;
  }
};

// In the order of the runs.
std::vector<Group> groups_of(const std::vector<Row>& rows) {
  std::vector<Group> groups;
  for (const Row& row : rows) {
    const auto same = [&](const Group& group) {
      return group.scene == row.run->scene && group.config == row.run->config;
    };
    auto group = std::find_if(groups.begin(), groups.end(), same);
    if (group == groups.end()) {
      groups.push_back(Group{row.run->scene, row.run->config, {}, 0});
      group = groups.end() - 1;
    }
    ++group->wanted;
    if (!row.results.is_null()) group->rows.push_back(&row);
  }
  return groups;
}

// ---- the three files ------------------------------------------------------------------------------------

std::string plain(const Json& value) {
  return value.is_string() ? value.get<std::string>() : value.dump();
}

std::string csv_text(const std::vector<Row>& rows) {
  std::string text = "scene,config,seed,state";
  for (const Metric& metric : kMetrics) text += fmt::format(",{}", metric.key);
  for (const char* key : kProvenance) text += fmt::format(",{}", key);
  text += ",folder\n";
  for (const Row& row : rows) {
    text += fmt::format("{},{},{},{}", row.run->scene, row.run->config, row.run->seed, row.state);
    for (const Metric& metric : kMetrics) {
      const auto value = value_of(row, metric);
      text += value ? fmt::format(",{}", *value) : ",";
    }
    for (const char* key : kProvenance)
      text +=
          fmt::format(",{}", row.results.contains(key) ? csv_cell(plain(row.results[key])) : "");
    text += fmt::format(",{}\n", csv_cell(row.run->folder.root().string()));
  }
  return text;
}

// The settings that are not at their default, by key. TOML text of a value is also JSON, unless it
// has bytes that are not UTF-8, as paths may have.
Json settings_json(const ExperimentRun& run) {
  Json json = Json::object();
  for (const SettingChange& change : config_diff(Config{}, run.settings)) {
    Json value = Json::parse(change.b, nullptr, false);
    json[change.key] = value.is_discarded() ? Json(change.b) : std::move(value);
  }
  return json;
}

Json group_json(const Group& group) {
  Json json = {{"scene", group.scene},
               {"config", group.config},
               {"finished", group.rows.size()},
               {"runs", group.wanted}};
  for (const Metric& metric : kMetrics)
    if (const auto spread = group.spread(metric))
      json[metric.key] = {
          {"mean", spread->mean},
          {"standard_deviation", spread->deviation ? Json(*spread->deviation) : Json(nullptr)}};
  return json;
}

std::string json_text(const Experiment& experiment, const std::vector<Row>& rows,
                      const std::vector<Group>& groups) {
  Json json = {{"experiment", experiment.file.string()},
               {"version", kVersion},
               {"commit", built_commit()},
               {"date", utc_date()},
               {"summary", Json::array()},
               {"runs", Json::array()}};
  for (const Group& group : groups) json["summary"].push_back(group_json(group));
  for (const Row& row : rows)
    json["runs"].push_back({{"scene", row.run->scene},
                            {"config", row.run->config},
                            {"seed", row.run->seed},
                            {"state", row.state},
                            {"folder", row.run->folder.root().string()},
                            {"settings", settings_json(*row.run)},
                            {"results", row.results}});
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::string number_text(const Metric& metric, double value) {
  if (metric.digits == 0) return with_commas(std::uint64_t(std::llround(value / metric.unit)));
  return fmt::format("{:.{}f}", value / metric.unit, metric.digits);
}

std::string spread_text(const Group& group, const Metric& metric) {
  const auto spread = group.spread(metric);
  if (!spread) return "-";
  const std::string mean = number_text(metric, spread->mean);
  return spread->deviation ? mean + " ± " + number_text(metric, *spread->deviation) : mean;
}

// Those that any run has.
std::vector<Metric> metrics_in(const std::vector<Row>& rows) {
  std::vector<Metric> metrics;
  for (const Metric& metric : kMetrics)
    if (std::any_of(rows.begin(), rows.end(),
                    [&](const Row& row) { return value_of(row, metric).has_value(); }))
      metrics.push_back(metric);
  return metrics;
}

std::string table_of_means(const std::vector<Group>& groups, const std::vector<Metric>& metrics) {
  std::vector<std::string> titles = {"scene", "config", "runs"};
  for (const Metric& metric : metrics) titles.push_back(metric.title);
  std::string text = markdown_header(titles);
  for (const Group& group : groups) {
    std::vector<std::string> cells = {group.scene, group.config,
                                      fmt::format("{}/{}", group.rows.size(), group.wanted)};
    for (const Metric& metric : metrics) cells.push_back(spread_text(group, metric));
    text += markdown_row(cells);
  }
  return text;
}

std::string table_of_runs(const std::vector<Row>& rows, const std::vector<Metric>& metrics) {
  std::vector<std::string> titles = {"scene", "config", "seed", "state"};
  for (const Metric& metric : metrics) titles.push_back(metric.title);
  std::string text = markdown_header(titles);
  for (const Row& row : rows) {
    std::vector<std::string> cells = {row.run->scene, row.run->config,
                                      std::to_string(row.run->seed), row.state};
    for (const Metric& metric : metrics) {
      const auto value = value_of(row, metric);
      cells.push_back(value ? number_text(metric, *value) : "-");
    }
    text += markdown_row(cells);
  }
  return text;
}

std::string table_of_configs(const std::vector<Row>& rows) {
  std::string text =
      markdown_header({"config", "settings that differ from the defaults (of its first run)"});
  std::vector<std::string> seen;
  for (const Row& row : rows) {
    if (std::find(seen.begin(), seen.end(), row.run->config) != seen.end()) continue;
    seen.push_back(row.run->config);
    std::vector<std::string> settings;
    const Json changed = settings_json(*row.run);
    for (const auto& [key, value] : changed.items())
      if (key != "dataset.source" && key != "train.seed")
        settings.push_back(fmt::format("`{}` = {}", key, value.dump()));
    text += markdown_row({row.run->config, fmt::format("{}", fmt::join(settings, ", "))});
  }
  return text;
}

// One line for each way in which runs were made: usually one.
std::string table_of_machines(const std::vector<Row>& rows) {
  const std::vector<const char*> keys = {"version", "commit", "device", "cpu", "driver"};
  std::string text = markdown_header({"version", "commit", "device", "CPU", "driver"});
  std::vector<std::string> seen;
  for (const Row& row : rows) {
    if (row.results.is_null()) continue;
    std::vector<std::string> cells;
    for (const char* key : keys)
      cells.push_back(row.results.contains(key) ? plain(row.results[key]) : "-");
    const std::string line = markdown_row(cells);
    if (std::find(seen.begin(), seen.end(), line) != seen.end()) continue;
    seen.push_back(line);
    text += line;
  }
  return text;
}

std::string markdown_text(const Experiment& experiment, const std::vector<Row>& rows,
                          const std::vector<Group>& groups, std::size_t finished) {
  const std::vector<Metric> metrics = metrics_in(rows);
  return fmt::format(
      "# {}\n\n{} of {} runs are finished. Means and standard deviations over seeds; written "
      "{}.\n\n{}\n"
      "## Runs\n{}\n## Configs\n{}\n## Made with\n{}",
      experiment.file.filename().string(), finished, rows.size(), utc_date(),
      table_of_means(groups, metrics), table_of_runs(rows, metrics), table_of_configs(rows),
      table_of_machines(rows));
}

}  // namespace

std::size_t write_tables(const Experiment& experiment, const std::vector<ExperimentRun>& runs,
                         const std::vector<std::size_t>& failed) {
  const std::vector<Row> rows = rows_of(runs, failed);
  const std::vector<Group> groups = groups_of(rows);
  const auto finished = std::size_t(std::count_if(
      rows.begin(), rows.end(), [](const Row& row) { return !row.results.is_null(); }));
  write_text(experiment.output / "results.csv", csv_text(rows));
  write_text(experiment.output / "results.json", json_text(experiment, rows, groups));
  write_text(experiment.output / "results.md", markdown_text(experiment, rows, groups, finished));
  return finished;
}

std::string figures_of(const ExperimentRun& run) {
  const Row row{&run, "", read_results(run)};
  std::string text;
  for (const Metric& metric : kMetrics)
    if (const auto value = value_of(row, metric); value && metric.of_views)
      text +=
          fmt::format("{}{} {:.{}f}", text.empty() ? "" : ", ", metric.key, *value, metric.digits);
  return text;
}

}  // namespace gs
