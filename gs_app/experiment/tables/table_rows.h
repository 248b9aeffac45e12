// SPDX-License-Identifier: Apache-2.0
// The data behind an experiment's tables: every run with its results, and the runs of one scene and
// config as a group.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "gs_app/experiment/experiment_run.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// A number of results.json that the tables show. To add one, add a row to kMetrics in
/// table_rows.cpp.
struct Metric {
  const char *key, *title;
  bool is_of_views;  // in results.json under "test", or under "train" if no view was held out
  double unit;       // of the Markdown table; its title names it
  int digits;        // after the point, in the Markdown table
};

/// One run. `state` is "finished", "failed" or "missing".
struct RunRow {
  const ExperimentRun* run;
  std::string state;
  Json results;  // its results.json; null unless it is finished
};

/// Of some runs.
struct Spread {
  double mean = 0;
  std::optional<double> deviation;  // of a sample (n - 1); nothing for a single run
};

/// Nothing if there are no values.
std::optional<Spread> spread_of(const std::vector<double>& values);

/// The runs of one scene and config, one for each seed.
struct Group {
  std::string scene, config;
  std::vector<const RunRow*> rows;  // finished runs
  std::size_t wanted = 0;           // all runs
};

/// A row for every run, in the order of `runs`. `failed` holds the indices of runs that have
/// failed.
std::vector<RunRow> rows_of(const std::vector<ExperimentRun>& runs,
                            const std::vector<std::size_t>& failed);

/// The groups, in the order of their first runs. They refer to `rows`.
std::vector<Group> groups_of(const std::vector<RunRow>& rows);

/// The metrics that at least one run has.
std::vector<Metric> metrics_in(const std::vector<RunRow>& rows);

/// A metric of one run; nothing if its results do not have it.
std::optional<double> value_of(const RunRow& row, const Metric& metric);

/// Mean and standard deviation over the finished runs of a group; nothing if none has the metric.
std::optional<Spread> spread_of(const Group& group, const Metric& metric);

/// "psnr 25.31, ssim 0.8123": the image metrics of one finished run in a few words.
std::string summary_of(const ExperimentRun& run);

/// All metrics, whether runs have them or not: the columns of results.csv.
const std::vector<Metric>& all_metrics();

/// Adds a name to those found so far, unless it is one of them.
void add_name(const std::string& name, std::vector<std::string>& names);

}  // namespace gs
