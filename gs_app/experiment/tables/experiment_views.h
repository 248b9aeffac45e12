// SPDX-License-Identifier: Apache-2.0
// Views of an experiment's results.json (experiment_json.h).
#pragma once

#include <string>

#include "gs_core/system/text/json.h"

namespace gs {

/// results.md, for people: means, differences, every run, scenes, configs, the builds and machines
/// that the runs were made with, and the provenance.
std::string experiment_markdown(const Json& experiment);

/// results.csv: a row for every run with scene, config, seed, state, metrics, provenance, folder.
std::string experiment_csv(const Json& experiment);

}  // namespace gs
