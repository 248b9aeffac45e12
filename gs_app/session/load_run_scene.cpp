// SPDX-License-Identifier: Apache-2.0
#include "gs_app/session/load_run_scene.h"

#include <spdlog/fmt/fmt.h>

#include "data_loaders/doctor/forecast.h"
#include "data_loaders/reconstruct/photo_folder.h"
#include "gs_app/run/text.h"
#include "gs_core/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// The scene is made in another folder. Masks beside the photos stay where they are.
void move_source(DatasetConfig& dataset, const fs::path& scene) {
  const bool is_named = !dataset.masks.empty();
  const auto masks = fs::path(dataset.source) / (is_named ? dataset.masks : "masks");
  if (dataset.masks != "none" && (is_named || fs::is_directory(masks)))
    dataset.masks = masks.string();
  dataset.source = scene.string();
}

}  // namespace

void reconstruct_bare_photos(Config& config, const RunFolder& folder, SessionHooks& hooks) {
  DatasetConfig& dataset = config.dataset;
  const bool places_are_named = !dataset.model.empty() || dataset.images != DatasetConfig{}.images;
  if (places_are_named || !holds_only_photos(dataset.source)) return;
  log_info("{} holds pictures and no camera poses: COLMAP looks for them first", dataset.source);
  make_run_folder(folder);  // first, because it moves an older run aside together with its scene
  const auto scene = fs::absolute(folder.root() / "scene").lexically_normal();
  const Reconstruction result =
      run_colmap({dataset.source, scene, config.reconstruct, config.train.threads, false},
                 [&](ColmapStage stage, std::int64_t done, std::int64_t total) {
                   hooks.show_colmap(stage, done, total);
                 });
  log_info("{}", describe(result));
  move_source(dataset, scene);
}

Scene load_run_scene(const DatasetConfig& dataset, SessionHooks& hooks) {
  Scene scene = load_scene(dataset, [&](LoadStage stage, std::size_t done, std::size_t total) {
    hooks.show_loading(stage, done, total);
  });
  const View& first = scene.train_views.empty() ? scene.test_views.at(0) : scene.train_views[0];
  log_info("{}: {} views to train on, {} held out, {}x{} pixels; {} points, extent {:.3g}",
           scene.source, scene.train_views.size(), scene.test_views.size(), first.camera.width,
           first.camera.height, with_commas(scene.points.size()), scene.extent);
  return scene;
}

void log_forecast(const Config& config, const Scene& scene) {
  double photos = 0, pixels = 0;
  for (const std::vector<View>* views : {&scene.train_views, &scene.test_views})
    for (const View& view : *views) {
      photos += double(photo_bytes(view));
      pixels += double(view.camera.width) * view.camera.height;
    }
  const std::size_t views = scene.train_views.size() + scene.test_views.size();
  log_info("forecast: {}", forecast(config, photos, pixels * 1e-6 / double(views)));
}

}  // namespace gs
