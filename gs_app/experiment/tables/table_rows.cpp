// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/table_rows.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

constexpr double kMiB = 1 << 20;
const std::vector<Metric> kMetrics = {
    {"psnr", "PSNR / dB", true, 1, 2},
    {"ssim", "SSIM", true, 1, 4},
    {"flip", "FLIP", true, 1, 4},
    {"lpips", "LPIPS", true, 1, 4},
    {"psnr_photometric", "predicted PSNR / dB", true, 1, 2},
    {"ssim_photometric", "predicted SSIM", true, 1, 4},
    {"psnr_exposure", "solved PSNR / dB", true, 1, 2},
    {"ssim_exposure", "solved SSIM", true, 1, 4},
    {"psnr_cc", "fitted PSNR / dB", true, 1, 2},
    {"ssim_cc", "fitted SSIM", true, 1, 4},
    {"depth_error", "depth error", true, 1, 4},
    {"num_gaussians", "Gaussians", false, 1, 0},
    {"train_seconds", "training / s", false, 1, 1},
    {"peak_host_bytes", "memory / MiB", false, kMiB, 0},
    {"peak_gpu_bytes", "GPU memory / MiB", false, kMiB, 0},
    {"forecast_gpu_bytes", "its forecast / MiB", false, kMiB, 0},
};

// Null if the file is missing or damaged. Throws AccessError if it cannot be read now.
Json read_results(const ExperimentRun& run) {
  try {
    return read_json(run.folder.results());
  } catch (const AccessError&) {
    throw;
  } catch (const Error&) {
    return nullptr;
  }
}

}  // namespace

const std::vector<Metric>& all_metrics() { return kMetrics; }

std::vector<RunRow> rows_of(const std::vector<ExperimentRun>& runs,
                            const std::vector<std::size_t>& failed) {
  std::vector<RunRow> rows;
  for (const ExperimentRun& run : runs) {
    RunRow row{&run, "missing", nullptr};
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

std::vector<Group> groups_of(const std::vector<RunRow>& rows) {
  std::vector<Group> groups;
  for (const RunRow& row : rows) {
    const auto is_same = [&](const Group& group) {
      return group.scene == row.run->scene && group.config == row.run->config;
    };
    auto group = std::find_if(groups.begin(), groups.end(), is_same);
    if (group == groups.end()) {
      groups.push_back(Group{row.run->scene, row.run->config, {}, 0});
      group = groups.end() - 1;
    }
    ++group->wanted;
    if (!row.results.is_null()) group->rows.push_back(&row);
  }
  return groups;
}

std::vector<Metric> metrics_in(const std::vector<RunRow>& rows) {
  std::vector<Metric> metrics;
  for (const Metric& metric : kMetrics)
    if (std::any_of(rows.begin(), rows.end(),
                    [&](const RunRow& row) { return value_of(row, metric).has_value(); }))
      metrics.push_back(metric);
  return metrics;
}

std::optional<double> value_of(const RunRow& row, const Metric& metric) {
  if (row.results.is_null()) return std::nullopt;
  const Json* holder = &row.results;
  if (metric.is_of_views) {
    const bool has_test = row.results.contains("test") && row.results["test"].is_object();
    const char* split = has_test ? "test" : "train";
    if (!row.results.contains(split)) return std::nullopt;
    holder = &row.results.at(split);
  }
  if (!holder->is_object() || !holder->contains(metric.key) || !holder->at(metric.key).is_number())
    return std::nullopt;
  return holder->at(metric.key).get<double>();
}

std::optional<Spread> spread_of(const Group& group, const Metric& metric) {
  std::vector<double> values;
  for (const RunRow* row : group.rows)
    if (const auto value = value_of(*row, metric)) values.push_back(*value);
  return spread_of(values);
}

std::optional<Spread> spread_of(const std::vector<double>& values) {
  if (values.empty()) return std::nullopt;
  Spread spread;
  for (const double value : values) spread.mean += value / double(values.size());
  if (values.size() < 2) return spread;
  double squares = 0;
  for (const double value : values) squares += (value - spread.mean) * (value - spread.mean);
  spread.deviation = std::sqrt(squares / double(values.size() - 1));
  return spread;
}

std::string summary_of(const ExperimentRun& run) {
  const RunRow row{&run, "", read_results(run)};
  std::string text;
  for (const Metric& metric : kMetrics)
    if (const auto value = value_of(row, metric); value && metric.is_of_views)
      text +=
          fmt::format("{}{} {:.{}f}", text.empty() ? "" : ", ", metric.key, *value, metric.digits);
  return text;
}

void add_name(const std::string& name, std::vector<std::string>& names) {
  if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
}

}  // namespace gs
