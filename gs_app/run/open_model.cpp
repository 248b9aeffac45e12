// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/open_model.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/formats/formats.h"
#include "data_loaders/refine/exposure_file.h"
#include "data_loaders/scene/load_scene.h"
#include "gs_core/error.h"
#include "gs_core/io/read_json.h"
#include "gs_core/log.h"
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
        " holds no point_cloud/iteration_N/point_cloud.ply; name a run's folder or a PLY file");
  if (!step) return run.ply(*newest);
  throw Error("the run in " + name + " saved no model after step " + std::to_string(*step) +
              "; the newest is that of step " + std::to_string(*newest));
}

// What a file of an export cannot say itself: its sidecar may. Of a model that was turned, moved or scaled
// nothing is taken: it is nobody's frame but its own.
void take_sidecar(const fs::path& file, GaussianModel& model) {
  const fs::path sidecar = sidecar_of(file);
  const ModelFormat* const format = find_format(file);
  if (!format || !fs::exists(sidecar)) return;
  try {
    const nlohmann::json json = read_json(sidecar);
    const auto rows = json.at("input_from_file").get<std::vector<std::vector<double>>>();
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        const double expected = i != j   ? 0
                                : i == 0 ? format->signs.x
                                : i == 1 ? format->signs.y
                                         : format->signs.z;
        if (std::abs(rows.at(i).at(j) - expected) > 1e-9) return;
      }
    model.antialiased = json.at("antialiased").get<bool>();
    for (int i = 0; i < 3; ++i) model.world_offset[i] = rows.at(i).at(3);
    model.is_ours = true;
  } catch (const std::exception& error) {
    log_warning("{} is left aside: {}", sidecar.string(), error.what());
  }
}

}  // namespace

fs::path sidecar_of(const fs::path& file) { return file.string() + ".transforms.json"; }

OpenedModel open_model(const fs::path& path, std::optional<int> step) {
  OpenedModel opened;
  opened.ply = path;
  if (fs::is_directory(path)) {
    opened.run.emplace(path);
    opened.ply = ply_of(*opened.run, step);
    if (fs::exists(opened.run->config())) load_config(opened.config, opened.run->config());
    opened.config.train = {};  // where a model was trained says nothing of where it is looked at
  }
  opened.model = read_model(opened.ply);
  take_sidecar(opened.ply, opened.model);
  opened.config.model.sh_degree = opened.model.sh_degree;
  opened.config.render.antialias = opened.model.antialiased;
  if (!opened.model.is_ours) opened.config.render.blend_rule = BlendRule::classic;  // as it was trained
  return opened;
}

Scene scene_for(const OpenedModel& opened, DatasetConfig dataset, bool is_other_scene) {
  if (dataset.source.empty()) throw UsageError("which photos? give the scene with --data SCENE");
  const bool has_file = opened.run && !is_other_scene && fs::exists(opened.run->exposures());
  if (has_file) dataset.exposure = false;
  Scene scene = load_scene(dataset);
  bring_to_offset(scene, opened.model.world_offset);
  if (has_file) apply_exposures(read_exposures(opened.run->exposures()), scene);
  return scene;
}

RenderSettings view_settings(const OpenedModel& opened, Config config) {
  config.model.sh_degree = std::min(config.model.sh_degree, opened.model.sh_degree);
  RenderSettings settings = render_settings(config);
  settings.for_backward = false;
  return settings;
}

}  // namespace gs
