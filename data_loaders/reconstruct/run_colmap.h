// SPDX-License-Identifier: Apache-2.0
// From photos, or frames of videos, to a scene by the `colmap` program: features, matches, the mapper, the largest model. Comes
// before find_scene.h in the pipeline.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "gs_core/config/config.h"

namespace gs {

enum class ColmapStage { frames, features, matches, model };

/// Called at a stage's beginning with `done` 0, and as COLMAP goes on.
using ColmapProgress =
    std::function<void(ColmapStage stage, std::int64_t done, std::int64_t total)>;

/// What is to be made of what.
struct ColmapJob {
  std::filesystem::path photos;  // a folder of photos or videos, or a video; never changed
  std::filesystem::path scene;   // images/, sparse/N, database.db, colmap.log, reconstruct.json
  ReconstructConfig settings;
  int threads = 0;     // 0: all cores
  bool force = false;  // move what is in `scene` to scene.bak-N first
};

struct MissingPhoto {
  std::string name, reason;
};

/// What came of it.
struct Reconstruction {
  std::filesystem::path scene;
  std::size_t photos = 0, registered = 0, points = 0, models = 0;
  double mean_error = 0;              // of the points' reprojection, pixels
  std::vector<MissingPhoto> missing;  // from the largest model
};

/// Makes the scene. Stages that reconstruct.json says are complete for the same photos and settings are
/// passed over. Throws UsageError where `scene` holds anything else and `force` is not set; Error where
/// COLMAP is missing, fails, is interrupted (what is complete stays) or places fewer than three photos.
Reconstruction run_colmap(const ColmapJob& job, const ColmapProgress& progress);

/// The verdict in a few lines.
std::string describe(const Reconstruction& result);

}  // namespace gs
