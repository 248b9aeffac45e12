// SPDX-License-Identifier: Apache-2.0
// The files of a run that refines poses.
#pragma once

#include "gs_app/run/run_folder.h"
#include "gs_train/loop/trainer.h"

namespace gs {

/// Writes poses.json, and cameras.json with the poses as they are now. Does nothing in other runs.
void save_poses(const RunFolder& folder, Trainer& trainer);

/// Writes sparse/0: the scene's camera model as COLMAP has it, with the refined poses of training
/// photos. Lenses, points and tracks are those that the run was trained with. Does nothing in other
/// runs, and for scenes of arrays or of films, which are no photos that COLMAP could read. Throws
/// Error where the scene's model cannot be read any more.
void save_refined_model(const RunFolder& folder, Trainer& trainer);

}  // namespace gs
