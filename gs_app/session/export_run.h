// SPDX-License-Identifier: Apache-2.0
// The trained model in other formats, beside the PLY of the last step.
#pragma once

#include <string>
#include <vector>

#include "gs_app/run/run_folder.h"
#include "gs_train/loop/trainer.h"

namespace gs {

/// Writes the model of a finished run in each of these formats (their names, such as "spz"), and
/// logs size and fidelity. Throws Error.
void export_run(const std::vector<std::string>& formats, const RunFolder& folder, Trainer& trainer);

/// Those of the formats whose file and sidecar are not both there for the run's newest model.
std::vector<std::string> missing_exports(const std::vector<std::string>& formats,
                                         const RunFolder& folder);

}  // namespace gs
