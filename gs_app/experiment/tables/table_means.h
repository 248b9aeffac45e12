// SPDX-License-Identifier: Apache-2.0
// Means over the scenes of an experiment.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "gs_app/experiment/tables/table_rows.h"

namespace gs {

/// The runs of one config in all scenes.
struct SceneMean {
  std::string config;
  std::vector<std::vector<const RunRow*>> seeds;  // a run of each scene, where all have finished
  std::size_t wanted = 0;                         // seeds
};

/// One for each config, in the order of their first runs. They refer to `rows`. Empty for an
/// experiment of a single scene.
std::vector<SceneMean> scene_means_of(const std::vector<RunRow>& rows);

/// The mean over scenes of a metric, for each seed; of these the mean and the standard deviation.
/// Nothing if a run does not have the metric.
std::optional<Spread> spread_of(const SceneMean& mean, const Metric& metric);

}  // namespace gs
