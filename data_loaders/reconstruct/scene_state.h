// SPDX-License-Identifier: Apache-2.0
// reconstruct.json, which records what is complete in a scene's folder; and the folder before the
// first stage.
#pragma once

#include <set>
#include <string>

#include "data_loaders/reconstruct/colmap_plan.h"

namespace gs {

/// For which photos and settings (made_of()) which stages are complete.
struct SceneState {
  std::string made_of;
  std::set<std::string> complete;  // names of stages
};

/// Empty where the file is missing or damaged.
SceneState read_state(const SceneFiles& files);
void write_state(const SceneFiles& files, const SceneState& state);

/// Makes the folder ready for the stages that the returned state lacks. `stages` are the names of
/// all stages. A scene of the same photos and settings is continued, an unfinished one of others
/// started over. A finished scene of others, or one of another program, is moved to SCENE.bak-N if
/// `job.force`; if not, throws UsageError.
SceneState prepare_folder(const ColmapPlan& plan, const ColmapJob& job,
                          const std::set<std::string>& stages);

}  // namespace gs
