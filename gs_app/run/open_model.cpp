// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/open_model.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "data_loaders/cameras/exposure_file.h"
#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/scene/load_scene.h"
#include "gs_app/run/pose_file.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_model/edit/model_moment.h"
#include "gs_model/formats/formats.h"
#include "gs_render/render_settings.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

fs::path ply_of(const RunFolder& run, std::optional<int> step) {
  const std::string name = run.root().string();
  if (step && fs::exists(run.ply(*step))) return run.ply(*step);
  const std::optional<int> newest = run.newest_step();
  if (!newest)
    throw Error(
        "the folder " + name +
        " holds no point_cloud/iteration_N/point_cloud.ply; name the folder that was given to "
        "`gemsplat train -o`, or a model's file (`gemsplat doctor` describes a scene)");
  if (!step) return run.ply(*newest);
  throw Error("the run in " + name + " saved no model after step " + std::to_string(*step) +
              "; the newest is that of step " + std::to_string(*newest));
}

}  // namespace

OpenedModel open_model(const fs::path& path, std::optional<int> step) {
  OpenedModel opened;
  opened.ply = path;
  if (const fs::path inside = model_in_folder(path); !inside.empty()) {
    opened.ply = inside;
  } else if (fs::is_directory(path)) {
    opened.run.emplace(path);
    opened.ply = ply_of(*opened.run, step);
    if (fs::exists(opened.run->config())) load_config(opened.config, opened.run->config());
    opened.config.train = {};  // rendering may use another device than training did
  }
  opened.model = read_model(opened.ply);
  opened.input_from_model = take_sidecar(opened.ply, opened.model);
  opened.config.model.sh_degree = opened.model.sh_degree;
  opened.config.render.antialias = opened.model.antialiased;
  // as it was trained
  if (!opened.model.is_ours) opened.config.render.blend_rule = BlendRule::classic;
  return opened;
}

void check_has_time(const OpenedModel& opened) {
  if (!opened.model.gaussians.has_time)
    throw UsageError(fmt::format("{} holds 3D Gaussians, which have no time; leave --time out",
                                 opened.ply.string()));
}

void take_moment(OpenedModel& opened, double time) {
  check_has_time(opened);
  opened.model = moment_of(opened.model, time);
}

Scene scene_for(const OpenedModel& opened, DatasetConfig dataset, bool is_other_scene) {
  if (opened.input_from_model && !dataset.source.empty())
    log_warning(
        "{} was turned, scaled or moved after training, and does not lie where the photos' cameras "
        "are; bring it back with `gemsplat edit --restore-frame`",
        opened.ply.string());
  return scene_for(opened.run ? &*opened.run : nullptr, std::move(dataset), is_other_scene,
                   opened.model.world_offset);
}

Scene scene_for(const RunFolder* run, DatasetConfig dataset, bool is_other_scene,
                const Vec3d& offset) {
  if (dataset.source.empty())
    throw UsageError("the photos are not known; give the scene with --data SCENE");
  if (is_other_scene) run = nullptr;
  const bool has_file = run && fs::exists(run->exposures());
  if (has_file) dataset.exposure = false;
  Scene scene = load_scene(dataset);
  bring_to_offset(scene, offset);
  if (has_file) apply_exposures(read_exposures(run->exposures()), scene);
  if (run && fs::exists(run->poses())) apply_poses(read_poses(run->poses()), scene);
  return scene;
}

RenderSettings view_settings(const OpenedModel& opened, Config config) {
  config.model.sh_degree = std::min(config.model.sh_degree, opened.model.sh_degree);
  RenderSettings settings = render_settings(config);
  settings.for_backward = false;
  return settings;
}

RenderSettings settings_of_model(const OpenedModel& opened, Config config) {
  config.model.sh_degree = opened.model.sh_degree;
  return view_settings(opened, config);
}

}  // namespace gs
