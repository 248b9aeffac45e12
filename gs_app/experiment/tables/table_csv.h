// SPDX-License-Identifier: Apache-2.0
// results.csv of an experiment.
#pragma once

#include <string>
#include <vector>

#include "gs_app/experiment/tables/table_rows.h"

namespace gs {

/// A row for every run: scene, config, seed, state, metrics, provenance, folder.
std::string experiment_csv(const std::vector<RunRow>& rows);

}  // namespace gs
