// SPDX-License-Identifier: Apache-2.0
// results.md of an experiment: its tables for people.
#pragma once

#include <string>
#include <vector>

#include "gs_app/experiment/table_scenes.h"

namespace gs {

/// Five tables: means over seeds, runs, scenes, configs, and the builds and machines that the runs
/// were made with.
std::string experiment_markdown(const Experiment& experiment, const std::vector<SceneRow>& scenes,
                                const std::vector<RunRow>& rows, const std::vector<Group>& groups,
                                std::size_t finished);

}  // namespace gs
