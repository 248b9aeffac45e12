// SPDX-License-Identifier: Apache-2.0
// gemsplat undistort: a copy of a scene with PINHOLE cameras, for other trainers.
#include <spdlog/fmt/fmt.h>

#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/undistort_scene.h"
#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/output_place.h"
#include "gs_app/run/text.h"
#include "gs_core/system/files/output_lock.h"

namespace gs {
namespace {

struct UndistortJob : JobSettings {
  std::string output;
  int jpeg_quality = 0;  // 0: PNG
  bool force = false;
};

void visit_options(UndistortJob& job, OptionList& option) {
  option.setting("scene,-s,--source-path,-d,--data", "dataset.source", "Scene");
  option.setting("--images", "dataset.images", "Scene");
  option.setting("--masks", "dataset.masks", "Scene");
  option.setting("--invert-masks", "dataset.invert_masks", "Scene");
  option.setting("--depth", "dataset.depth", "Scene");
  option("-o,--output", job.output,
         "folder of the copy; it must be empty or not exist [beside the scene: SCENE-undistorted]")
      .takes("FOLDER");
  option("--force", job.force, "if the folder is not empty, rename it to FOLDER.bak-N first");
  option("--jpeg", job.jpeg_quality,
         "write JPEG of this quality, 1 to 100, instead of PNG, and print the loss")
      .takes("QUALITY")
      .between(1, 100);
  general_options(option);
}

std::string text_of(const UndistortJob& job, const UndistortedScene& scene) {
  std::string text =
      fmt::format("{}: {} photos undistorted, {} copied, {} masks{}\n", job.output,
                  scene.undistorted, scene.copied, scene.masks,
                  scene.depth_maps > 0 ? fmt::format(", {} depth maps", scene.depth_maps) : "");
  if (scene.undistorted > 0 && job.jpeg_quality > 0)
    text += fmt::format(
        "JPEG of quality {} loses some detail: {:.1f} dB compared with the undistorted pixels; "
        "without --jpeg, PNG loses nothing\n",
        job.jpeg_quality, scene.jpeg_psnr);
  return text;
}

Json json_of(const UndistortJob& job, const UndistortedScene& scene) {
  Json json = {{"scene", job.output},
               {"undistorted", scene.undistorted},
               {"copied", scene.copied},
               {"masks", scene.masks},
               {"depth_maps", scene.depth_maps}};
  if (scene.undistorted > 0 && job.jpeg_quality > 0) json["jpeg_psnr"] = scene.jpeg_psnr;
  return json;
}

Outcome run(UndistortJob job, JobEvents& events) {
  const Config config = resolve_to_work(job);
  if (config.dataset.source.empty())
    throw UsageError("there is no scene; give its folder: gemsplat undistort SCENE");
  if (job.output.empty() || job.force) find_scene(config.dataset);  // a wrong name moves nothing
  if (job.output.empty())
    job.output = new_place(beside(config.dataset.source, "-undistorted")).string();
  if (job.force) {
    OutputLock::of_freed_folder(job.output, inputs_of(job, config));
  }
  const UndistortedScene scene = undistort_scene(
      config.dataset, job.output, job.jpeg_quality,
      [&](std::size_t done, std::size_t total) { events.progress("", "photo", done, total); });
  const char* const mode = scene.needs_background ? " --mask-mode background" : "";
  return {text_of(job, scene),
          json_of(job, scene),
          {{"train on it with", fmt::format("gemsplat train {}{}", shell_word(job.output), mode)}}};
}

}  // namespace

Verb undistort_verb() {
  return verb_of<UndistortJob>(
      "undistort", VerbGroup::change,
      "Write a copy of a scene with undistorted photos and PINHOLE cameras",
      {"undistort scene", "undistort scene -o flat --jpeg 95", "undistort scene -o flat --force"});
}

}  // namespace gs
