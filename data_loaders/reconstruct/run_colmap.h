// SPDX-License-Identifier: Apache-2.0
// From photos or videos to a scene that can be trained on, with the program `colmap`: features,
// matches, camera poses. Comes before find_scene.h in the pipeline.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/config/config.h"

namespace gs {

enum class ColmapStage { frames, copies, features, matches, model };

/// Called at the beginning of a stage with `done` 0, and whenever COLMAP reports progress.
using ColmapProgress =
    std::function<void(ColmapStage stage, std::int64_t done, std::int64_t total)>;

/// A request: the photos, and the scene that is made from them.
struct ColmapJob {
  std::filesystem::path photos;  // a folder of photos or videos, or a video; never changed
  std::filesystem::path scene;   // images/, sparse/N, database.db, colmap.log, reconstruct.json
  ReconstructConfig settings;
  int threads = 0;               // 0: all cores
  bool force = false;            // move what is in `scene` to scene.bak-N first
  bool has_short_flags = false;  // errors advise --colmap and --matching, not --set reconstruct.*
  /// Cameras and poses of the photos that are known: COLMAP only finds points for them. Image names
  /// are relative to `photos`.
  std::shared_ptr<const ColmapModel> poses = nullptr;
};

struct MissingPhoto {
  std::string name, reason;
};

struct Reconstruction {
  std::filesystem::path scene;
  std::size_t photos = 0, registered = 0, points = 0, models = 0;
  double mean_error = 0;              // of the points' reprojection, pixels
  std::vector<MissingPhoto> missing;  // from the largest model
};

/// Throws what run_colmap() would throw before it changes a file: COLMAP is missing, there are too
/// few photos, photos and scene are the same folder. Call it before an older result is moved away.
void check_reconstruction(const ColmapJob& job);

/// Makes the scene. Stages that reconstruct.json says are complete for the same photos and settings
/// are not run again. Throws UsageError where `scene` holds anything else and `force` is not set;
/// Error where COLMAP is missing, fails, is interrupted (what is complete stays) or places fewer
/// than three photos.
Reconstruction run_colmap(const ColmapJob& job, const ColmapProgress& progress);

/// The result in a few lines for people.
std::string describe(const Reconstruction& result);

}  // namespace gs
