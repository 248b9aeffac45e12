// SPDX-License-Identifier: Apache-2.0
// A checkpoint as a file. docs/reference/checkpoints.md lists its sections.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_train/loop/checkpoint.h"

namespace gs {

/// A view as a checkpoint records it, without its photo.
struct ViewRecord {
  std::string name;
  bool is_test = false;
  Camera camera;
  Vec3f exposure{1};
  std::uint64_t photo = 0;  // of the photo's file, photo_hashes(); 0: not known
};

/// What a run records of its scene, to recognize it when it is resumed.
struct SceneRecord {
  float extent = 1;
  Vec3d world_offset{0.0, 0.0, 0.0};
  std::vector<ViewRecord> views;  // training views, then test views

  SceneRecord() = default;
  explicit SceneRecord(const Scene& scene);
};

/// The contents of a checkpoint file. Together with the scene's photos, a run can go on from it.
struct Checkpoint {
  TrainingState state;
  Config config;
  SceneRecord scene;
};

/// The size of the file that write_checkpoint() writes of the model, in bytes, to within a few KiB.
std::uint64_t checkpoint_bytes(const TrainingModel& model, std::size_t views);

/// Writes the file, whole or not at all. The model may be in any memory, and is copied in pieces.
/// Throws Error if the disk is full or memory runs out.
void write_checkpoint(const std::filesystem::path& path, const Config& config,
                      const SceneRecord& scene, const RunProgress& progress,
                      const TrainingModel& model);

/// What is read of a file: all of it, or what stands in front of views and arrays, which is settings
/// and numbers of the progress. Only the whole shows whether a file is damaged.
enum class CheckpointPart { head, whole };

/// Throws Error "cannot read PATH: ..." for a file that is cut short, damaged, or of another
/// version.
Checkpoint read_checkpoint(const std::filesystem::path& path,
                           CheckpointPart part = CheckpointPart::whole);

}  // namespace gs
