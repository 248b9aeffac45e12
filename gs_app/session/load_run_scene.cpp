// SPDX-License-Identifier: Apache-2.0
#include "gs_app/session/load_run_scene.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <sstream>

#include "data_loaders/reconstruct/foreign_cameras.h"
#include "data_loaders/reconstruct/photo_folder.h"
#include "gs_app/run/text.h"
#include "gs_app/session/measure_light.h"
#include "gs_core/error.h"
#include "gs_core/forecast/training_memory.h"
#include "gs_core/memory.h"
#include "gs_core/system/log.h"
#include "gs_train/photometric/gains.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// The scene is made in another folder. Masks and maps beside the photos stay where they are.
void move_source(DatasetConfig& dataset, const fs::path& scene) {
  const auto keep_place = [&](std::string& folder, const char* usual) {
    const bool is_named = !folder.empty();
    const auto place = fs::path(dataset.source) / (is_named ? folder : usual);
    if (folder != "none" && (is_named || fs::is_directory(place))) folder = place.string();
  };
  keep_place(dataset.masks, "masks");
  keep_place(dataset.depth, "depth");
  keep_place(dataset.normals, "normals");
  dataset.source = scene.string();
}

void settle(Config& config, const PhotometricChoice& choice) {
  config.photometric.model = choice.has_gains ? kGainsModel : kNoPhotometricModel;
  log_info("photometric.model auto is {}: {}", config.photometric.model, choice.why);
}

void forget_exposures(Scene& scene) {
  scene.exposure.reset();
  for (auto* views : {&scene.train_views, &scene.test_views})
    for (View& view : *views) view.exposure = Vec3f(1);
}

void log_exposure_stops(const Scene& scene) {
  const auto& views = scene.train_views;
  const auto known = std::count_if(
      views.begin(), views.end(), [](const View& view) { return view.exposure_stops.has_value(); });
  if (known > 0)
    log_info("EXIF says of {} of {} training photos how they were exposed{}", known, views.size(),
             scene.exposure ? "" : "; the photometric model starts from it");
}

}  // namespace

bool reconstruct_bare_photos(Config& config, const RunFolder& folder,
                             const std::function<void()>& clear_folder, SessionHooks& hooks) {
  DatasetConfig& dataset = config.dataset;
  const bool places_are_named = !dataset.model.empty() || dataset.images != DatasetConfig{}.images;
  if (places_are_named || !holds_only_photos(dataset.source)) return false;
  if (const auto foreign = find_foreign_cameras(dataset.source))
    throw UsageError(text_of(*foreign, dataset.source));
  log_info("{} holds photos without camera poses: COLMAP computes them first", dataset.source);
  const auto scene = fs::absolute(folder.root() / "scene").lexically_normal();
  const ColmapJob job{dataset.source, scene, config.reconstruct, config.train.threads};
  check_reconstruction(job);
  clear_folder();
  const Reconstruction result =
      run_colmap(job, [&](ColmapStage stage, std::int64_t done, std::int64_t total) {
        hooks.show_colmap(stage, done, total);
      });
  std::istringstream lines(describe(result));
  for (std::string line; std::getline(lines, line);) log_info("{}", line);
  move_source(dataset, scene);
  return true;
}

Scene load_run_scene(const DatasetConfig& dataset, SessionHooks& hooks, const SceneNeeds& needs) {
  const auto show = [&](LoadStage stage, std::size_t done, std::size_t total) {
    hooks.show_loading(stage, done, total);
  };
  Scene scene = load_scene(dataset, show, PhotoLoading::as_they_fit, needs);
  const View& first = scene.train_views.empty() ? scene.test_views.at(0) : scene.train_views[0];
  log_info("{}: {} training views, {} held out, {}x{} pixels; {} points, extent {:.3g}",
           scene.source, scene.train_views.size(), scene.test_views.size(), first.camera.width,
           first.camera.height, with_commas(scene.points.size()), scene.extent);
  if (needs.exposure_stops) log_exposure_stops(scene);
  return scene;
}

Scene load_run_scene(Config& config, SessionHooks& hooks) {
  const PhotometricConfig& photometric = config.photometric;
  const bool is_learned = photometric.model != kNoPhotometricModel;
  const SceneNeeds needs{is_learned, config.surface.prior_weight > 0};
  if (photometric.model != kAutoPhotometricModel)
    return load_run_scene(config.dataset, hooks, needs);
  DatasetConfig dataset = config.dataset;
  dataset.exposure = dataset.exposure || why_exposures_are_unknown(dataset).empty();
  Scene scene = load_run_scene(dataset, hooks, needs);
  if (scene.exposure) settle(config, choose_photometric(scene.exposure, ""));
  if (!config.dataset.exposure) forget_exposures(scene);
  return scene;
}

void choose_photometric_model(Config& config, const Scene& scene) {
  if (config.photometric.model != kAutoPhotometricModel) return;
  settle(config, scene.exposure ? choose_photometric(scene.exposure, "")
                                : choose_photometric_by_run(config, scene));
}

ForecastDevice forecast_device(Backend& backend) {
  return {&backend.memory() != &host_memory(), backend.memory().free_bytes()};
}

void log_forecast(const Config& config, const Scene& scene, Backend& backend, std::size_t start) {
  SceneSize size;
  size.start = start;
  size.points = scene.points.size();
  for (const std::vector<View>* views : {&scene.train_views, &scene.test_views})
    for (const View& view : *views) {
      size.photo_bytes += double(photo_bytes(view));
      if (!view.source) size.loaded_bytes += double(photo_bytes(view) + map_bytes(view));
      size.megapixels += 1e-6 * double(view.camera.width) * double(view.camera.height);
    }
  size.megapixels /= double(scene.train_views.size() + scene.test_views.size());
  const PictureSizes pictures = picture_sizes(scene.train_views);
  size.train_share = pictures.photo_bytes / std::max(size.photo_bytes, 1.0);
  size.largest_megapixels = 1e-6 * pictures.pixels;
  for (const View& view : scene.train_views) {
    size.depth_maps += view.has_depth_map;
    size.normal_maps += view.has_normal_map;
  }
  const Forecast run = forecast(config, size, forecast_device(backend));
  log_info("forecast: {}", run.text);
  for (const std::string& warning : run.warnings) log_warning("{}", warning);
}

}  // namespace gs
