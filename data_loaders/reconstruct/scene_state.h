// SPDX-License-Identifier: Apache-2.0
// reconstruct.json, which records what is complete in a scene's folder and which of its files are
// ours; and the folder before the first stage.
#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>

#include "data_loaders/reconstruct/colmap_plan.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/files/owned_files.h"

namespace gs {

/// What reconstruct.json says.
struct SceneState {
  std::string made_of;             // photos and settings: made_of() of a plan
  std::set<std::string> complete;  // names of stages
  OwnedFiles::Stamps files = {};   // files of the scene that we put there
  std::string work = {};           // the name of a work folder that a kill may have left behind
};

/// A scene's folder that this process works on: the state, and every change of it, which is on the
/// disk when the call returns.
class SceneFolder {
 public:
  SceneFolder(const SceneFiles& files, SceneState state);
  ~SceneFolder();
  SceneFolder(const SceneFolder&) = delete;
  SceneFolder& operator=(const SceneFolder&) = delete;

  bool has(const std::string& stage) const { return state_.complete.contains(stage); }
  /// Records that a stage is complete, when its files are on the disk, too.
  void complete(const std::string& stage);
  /// Files of ours in the folder.
  OwnedFiles& files() { return owned_; }
  /// An empty folder in the scene's, which is removed at the end. A kill leaves it, and the next
  /// process removes it.
  const std::filesystem::path& work();
  /// Records that `stage` is complete and its result is WORK/sparse, then makes that the scene's
  /// sparse/. After a kill in between, the next process does the second half.
  void take_models(const std::string& stage);
  /// Forgets everything and removes our files, because photos or settings are others now.
  void start_over(const std::string& made_of);

 private:
  void save() const;
  void finish_taking_models();
  void remove_work();

  SceneFiles paths_;
  SceneState state_;
  OwnedFiles owned_;
  std::filesystem::path work_;
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
