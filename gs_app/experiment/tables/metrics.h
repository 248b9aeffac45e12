// SPDX-License-Identifier: Apache-2.0
// The numbers of a run's results.json that the tables of an experiment show.
#pragma once

#include <optional>
#include <vector>

#include "gs_core/system/text/json.h"

namespace gs {

/// To add a metric, add a row to all_metrics().
struct Metric {
  const char *key, *title;
  bool is_of_views;  // in results.json under "test", or under "train" if no view was held out
  double unit;       // of the Markdown table; its title names it
  int digits;        // after the point, in the Markdown table
};

/// All metrics, whether runs have them or not.
const std::vector<Metric>& all_metrics();

/// A metric in the results of a run; nothing if they do not have it, or are null.
std::optional<double> value_of(const Json& results, const Metric& metric);

}  // namespace gs
