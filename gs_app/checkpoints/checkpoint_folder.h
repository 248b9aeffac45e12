// SPDX-License-Identifier: Apache-2.0
// The checkpoints of one run: OUT/checkpoints/step_N.ckpt, the last two of them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <vector>

#include "gs_app/checkpoints/checkpoint_file.h"

namespace gs {

struct CheckpointPath {
  int step;
  std::filesystem::path file;
};

/// The files of a folder with names of checkpoints, the latest step first. Throws AccessError if
/// the folder cannot be listed.
std::vector<CheckpointPath> checkpoints_in(const std::filesystem::path& folder);

/// The latest checkpoint that is whole. A damaged file is named in a warning, and renamed to
/// FILE.refused. Throws AccessError if a file cannot be read now: it may be whole. With
/// CheckpointPart::head, the latest one whose head can be read; no file is renamed.
std::optional<Checkpoint> newest_checkpoint(const std::filesystem::path& folder,
                                            CheckpointPart part = CheckpointPart::whole);

/// The free space of the folder's file system, in bytes.
std::uint64_t free_space(const std::filesystem::path& folder);

/// Writes a run's checkpoints, and keeps the last two. If the disk is full, it warns, and training
/// goes on.
class CheckpointFolder final : public CheckpointStore {
 public:
  using FreeSpace = std::function<std::uint64_t(const std::filesystem::path&)>;
  CheckpointFolder(std::filesystem::path folder, const Config& config, SceneRecord scene,
                   FreeSpace space = free_space);

  bool save(const RunProgress& progress, const TrainingModel& model) override;
  std::optional<TrainingState> newest() override;
  /// Removes all but the newest one, from which a finished run can be extended.
  void keep_only_newest() { remove_all_but(1); }
  std::filesystem::path file_of(int step) const;

 private:
  bool has_space(std::uint64_t bytes, int step);
  void remove_all_but(std::size_t count);

  std::filesystem::path folder_;
  Config config_;
  SceneRecord scene_;
  FreeSpace space_;
};

}  // namespace gs
