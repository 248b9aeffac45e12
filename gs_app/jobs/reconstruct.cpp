// SPDX-License-Identifier: Apache-2.0
// gemsplat reconstruct: makes a scene from photos or videos with the program colmap.
#include <spdlog/fmt/fmt.h>

#include "data_loaders/reconstruct/photo_folder.h"
#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/scene_model.h"
#include "gs_app/jobs/parts/colmap_progress.h"
#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/output_place.h"
#include "gs_app/run/text.h"

namespace gs {
namespace {

struct ReconstructJob : JobSettings {
  std::string scene;
  bool force = false;
};

void visit_options(ReconstructJob& job, OptionList& option) {
  option.setting("photos,-d,--data", "dataset.source", "Scene",
                 "a folder of photos or videos, or a video; nothing in it is changed");
  option("-o,--output", job.scene, "folder of the new scene [beside the photos: PHOTOS-scene]")
      .takes("FOLDER")
      .group("Output");
  option("--force", job.force, "if SCENE holds a scene, move it to SCENE.bak-N first")
      .group("Output");
  option.setting("--frames", "reconstruct.frames", "COLMAP");
  option.setting("--matching", "reconstruct.matching", "COLMAP");
  option.setting("--mapper", "reconstruct.mapper", "COLMAP");
  option.setting("--camera-model", "reconstruct.camera_model", "COLMAP");
  option.setting("--single-camera", "reconstruct.single_camera", "COLMAP");
  option.setting("--max-features", "reconstruct.max_features", "COLMAP");
  option.setting("--colmap", "reconstruct.colmap", "COLMAP");
  general_options(option);
}

/// The cameras and poses of a scene that has no points; null for photos alone, and for a scene with
/// points, whose poses are found anew. `photos` becomes the folder of its photos.
std::shared_ptr<const ColmapModel> poses_without_points(const DatasetConfig& dataset,
                                                        std::filesystem::path& photos) {
  std::error_code ignored;
  if (!std::filesystem::is_directory(dataset.source, ignored) || holds_only_photos(dataset.source))
    return nullptr;
  SceneFolders folders;
  try {
    folders = find_scene(dataset);
  } catch (const Error&) {  // no scene: photos, or a sentence that helps
    return nullptr;
  }
  ColmapModel model;
  try {
    model = read_scene(dataset, folders).model;
  } catch (const Error& error) {
    if (folders.kind != SceneKind::foreign) throw;
    log_warning("{}; COLMAP places the photos anew", error.what());
    return nullptr;
  }
  if (!model.points.empty()) return nullptr;
  log_info("{} has cameras and no points: COLMAP finds points for these cameras", dataset.source);
  photos = folders.images;
  return std::make_shared<const ColmapModel>(std::move(model));
}

Outcome run(const ReconstructJob& job, JobEvents& events) {
  const Config config = resolve(job);
  if (config.dataset.source.empty())
    throw UsageError(
        "there are no photos; give their folder, or a video: gemsplat reconstruct PHOTOS");
  // A call that is repeated goes on in the same folder.
  const std::string scene =
      job.scene.empty() ? beside(config.dataset.source, "-scene").string() : job.scene;
  if (job.scene.empty()) say_place(scene);
  ColmapJob colmap{config.dataset.source, scene,     config.reconstruct,
                   config.train.threads,  job.force, true};
  colmap.poses = poses_without_points(config.dataset, colmap.photos);
  const Reconstruction result = run_colmap(colmap, ColmapEvents(events));
  const std::string log = (result.scene / "colmap.log").string();
  return {describe(result) + fmt::format("scene: {} (log: {})\n", scene, log),
          {{"scene", scene}, {"log", log}, {"summary", describe(result)}},
          {{"train it with", "gemsplat train " + shell_word(scene)}}};
}

}  // namespace

Verb reconstruct_verb() {
  return verb_of<ReconstructJob>(
      "reconstruct", VerbGroup::train, "Find where photos were taken, with COLMAP",
      {"reconstruct photos", "reconstruct film.mp4 -o scene --frames 200",
       "reconstruct photos -o scene --matching exhaustive"});
}

}  // namespace gs
