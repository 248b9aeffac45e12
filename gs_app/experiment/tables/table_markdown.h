// SPDX-License-Identifier: Apache-2.0
// results.md of an experiment: its tables for people.
#pragma once

#include <string>
#include <vector>

#include "gs_app/experiment/tables/table_latex.h"
#include "gs_app/experiment/tables/table_provenance.h"
#include "gs_app/experiment/tables/table_scenes.h"

namespace gs {

/// The tables of numbers, every run, scenes, configs, the builds and machines that the runs were made
/// with, and the provenance.
std::string experiment_markdown(const Experiment& experiment, const std::vector<SceneRow>& scenes,
                                const std::vector<RunRow>& rows, const PaperTables& tables,
                                const Provenance& provenance, std::size_t finished);

}  // namespace gs
