// SPDX-License-Identifier: Apache-2.0
// results.json of an experiment, from which its report is made (gs_app/report/report_experiment.h).
#pragma once

#include <string>
#include <vector>

#include "gs_app/experiment/table_scenes.h"

namespace gs {

/// {"experiment", "version", "commit", "date", "scenes", "configs", "summary", "runs"}. A scene has
/// "name", "path", "settings" and "views", a list of {"configs", "scene_hash", "train_views",
/// "test_views", "size"}; a config has "name" and "settings".
std::string experiment_json(const Experiment& experiment, const std::vector<SceneRow>& scenes,
                            const std::vector<RunRow>& rows, const std::vector<Group>& groups);

}  // namespace gs
