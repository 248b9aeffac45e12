// SPDX-License-Identifier: Apache-2.0
// Configs compared with a baseline, run by run: runs of the same scene and seed are a pair, so that
// what scene and seed do to both cancels.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "gs_app/experiment/tables/table_rows.h"

namespace gs {

/// The pairs of one config in one scene, or in all.
struct Comparison {
  std::string scene, config;                                   // scene: empty for all
  std::vector<std::pair<const RunRow*, const RunRow*>> pairs;  // finished: baseline, config
  std::size_t wanted = 0;                                      // pairs
};

struct Difference {
  double mean = 0;                       // config minus baseline
  std::optional<double> standard_error;  // of the mean; nothing for a single pair
};

/// For each config but the baseline: all scenes, then each of several. They refer to `rows`. Empty
/// without a baseline.
std::vector<Comparison> comparisons_of(const std::vector<RunRow>& rows,
                                       const std::string& baseline);

/// Nothing if no pair has the metric.
std::optional<Difference> difference_of(const Comparison& comparison, const Metric& metric);

}  // namespace gs
