// SPDX-License-Identifier: Apache-2.0
// The folder of a scene that is being made. Photos and models are made in a folder of their own in
// it and renamed into place when all is complete; reconstruct.json records how far that is.
#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>

#include "data_loaders/reconstruct/colmap_plan.h"
#include "gs_core/system/files/output_lock.h"

namespace gs {

/// What reconstruct.json says.
struct SceneState {
  std::string made_of;             // photos and settings: made_of() of a plan
  std::set<std::string> complete;  // names of stages
  std::string work = {};           // name of the work folder; empty: there is none
};

/// Whether a name has the form of work folders, ".gemsplat-XXXXXX". Others come from a damaged file.
bool is_work_folder(const std::string& name);

/// A scene's folder that this process works on: the state, and every change of it, which is on the
/// disk when the call returns.
class SceneFolder {
 public:
  /// Finishes what a kill has left half done (finish()).
  SceneFolder(const SceneFiles& files, SceneState state);

  bool has(const std::string& stage) const { return state_.complete.contains(stage); }
  /// Records that a stage is complete, when its files are on the disk, too.
  void complete(const std::string& stage);
  /// The work folder, in the scene's. It stays until the scene is finished or started over, so that
  /// a later command finds there what is complete.
  std::filesystem::path work();
  /// Records that the last stage is complete, then renames WORK/images and WORK/sparse to images/
  /// and sparse/, and removes the work folder. After a kill in between, the next process does the
  /// rest. Throws UsageError where another file has one of these names.
  void finish(const std::string& stage);
  /// Forgets everything and removes the work folder and COLMAP's files, because photos or settings
  /// are others now.
  void start_over(const std::string& made_of);

 private:
  void save() const;
  void move_in();
  void remove_work();

  SceneFiles paths_;
  SceneState state_;
};

/// Nothing if there is no reconstruct.json. Throws UsageError if it is not one of ours, or damaged.
std::optional<SceneState> read_state(const SceneFiles& files);

/// Makes the folder ready for the stages that are not complete. `stages` are the names of all
/// stages. A scene of the same photos and settings is continued, an unfinished one of others
/// started over. A finished scene of others, or one of another program, is moved to SCENE.bak-N if
/// `job.force`; if not, throws UsageError, as it does for single files that are in the way.
std::unique_ptr<SceneFolder> prepare_folder(const ColmapPlan& plan, const ColmapJob& job,
                                            const std::set<std::string>& stages, OutputLock& lock);

}  // namespace gs
