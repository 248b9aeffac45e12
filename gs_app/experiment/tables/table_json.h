// SPDX-License-Identifier: Apache-2.0
// results.json of an experiment, from which its report is made (gs_app/report/report_experiment.h).
#pragma once

#include <string>
#include <vector>

#include "gs_app/experiment/tables/table_differences.h"
#include "gs_app/experiment/tables/table_means.h"
#include "gs_app/experiment/tables/table_provenance.h"
#include "gs_app/experiment/tables/table_scenes.h"

namespace gs {

/// {"experiment", "version", "commit", "date", "provenance", "scenes", "configs", "summary",
/// "scene_means", "baseline", "differences", "runs"}. An entry of "scene_means" has "config",
/// "finished" and "seeds", and {"mean", "standard_deviation"} of each metric; one of "differences"
/// has "config", "scene" (null for all), "finished" and "pairs", and {"mean", "standard_error"} of
/// each metric; "baseline" is null where there is none. A scene has
/// "name", "path", "settings" and "views", a list of {"configs", "scene_hash", "train_views",
/// "test_views", "size"}; a config has "name" and "settings".
std::string experiment_json(const Experiment& experiment, const std::vector<SceneRow>& scenes,
                            const std::vector<RunRow>& rows, const std::vector<Group>& groups,
                            const std::vector<SceneMean>& means,
                            const std::vector<Comparison>& comparisons,
                            const Provenance& provenance);

}  // namespace gs
