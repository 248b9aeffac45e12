// SPDX-License-Identifier: Apache-2.0
// The order of an examination: folders, model, files, headers, pictures, cameras, points, sight,
// maps, forecast, blocks, light. Photos without a model have an order of their own.
#include "data_loaders/doctor/doctor.h"

#include <algorithm>

#include "data_loaders/doctor/examination.h"
#include "gs_core/camera.h"
#include "gs_core/config/scene_settings.h"
#include "gs_core/error.h"

namespace gs {
namespace {

using Level = Finding::Level;

/// The other faults that load_scene() refuses.
void check_the_rest(Examination& examination) {
  if (!examination.diagnosis.can_train()) return;
  try {
    check_scene(examination.config.dataset,
                {.normal_maps = examination.config.surface.prior_weight > 0});
  } catch (const Error& error) {
    examination.add(Level::fatal, "scene", error.what());
  }
}

SceneSize size_of(const Examination& examination) {
  double pixels = 0, training_pixels = 0;
  SceneSize scene;
  const int resolution = examination.config.dataset.resolution;
  for (const std::size_t i : examination.usable) {
    const Photo& photo = examination.scene.photos[i];
    const PhotoSize size = examination.picture_size_of(i);
    const double scale = scale_at_resolution(size.width, size.height, resolution);
    const double of_photo = double(size.width) * double(size.height) * std::min(scale * scale, 1.0);
    pixels += of_photo;
    if (!photo.is_test) training_pixels += of_photo;
    if (!photo.depth_file.empty()) scene.depth_maps += 1;
    if (!photo.normal_file.empty()) scene.normal_maps += 1;
    scene.largest_megapixels = std::max(scene.largest_megapixels, 1e-6 * of_photo);
  }
  scene.train_share = training_pixels / std::max(pixels, 1.0);
  scene.photo_bytes = (3 + examination.masked_share) * pixels;
  scene.megapixels = pixels * 1e-6 / double(std::max<std::size_t>(examination.usable.size(), 1));
  scene.points = examination.model().points.size();
  return scene;
}

void add_forecast(Examination& examination, const ForecastDevice& device) {
  const SceneSize size = size_of(examination);
  const Config config = resolved_config(
      examination.config, {size.points, examination.usable.size(), size.training_pixels()});
  const Forecast run = forecast(config, size, device);
  examination.add(Level::note, "forecast", run.text);
  for (const std::string& warning : run.warnings)
    examination.add(Level::warning, "forecast", warning);
}

void add_advice_on_blocks(Examination& examination, const ForecastDevice& device) {
  const BlockAdvice advice = advice_on_blocks(examination.config, size_of(examination), device);
  if (!advice.text.empty())
    examination.add(advice.blocks > 1 ? Level::note : Level::good, "blocks", advice.text);
}

}  // namespace

bool Diagnosis::can_train() const {
  return std::none_of(findings.begin(), findings.end(),
                      [](const Finding& finding) { return finding.level == Level::fatal; });
}

Diagnosis examine(const Config& config, bool look_at_pictures, const ProgressFn& progress,
                  const ForecastDevice& device) {
  Examination examination{config, progress};
  if (examine_bare_photos(examination, look_at_pictures)) return examination.diagnosis;
  if (!find_folders(examination) || !read_model(examination)) return examination.diagnosis;
  match_photo_files(examination);
  match_mask_files(examination);
  if (const std::size_t panoramas = split_panoramas(examination.scene))
    examination.add(Level::good, "panoramas", text_of_panoramas(panoramas));
  examine_headers(examination);
  examine_lenses(examination);
  if (look_at_pictures) examine_pictures(examination);
  examine_cameras(examination);
  examine_points(examination);
  examine_sight(examination);
  examine_depth(examination, look_at_pictures);
  examine_normals(examination, look_at_pictures);
  add_forecast(examination, device);
  add_advice_on_blocks(examination, device);
  check_the_rest(examination);
  if (look_at_pictures) examine_light(examination);
  return examination.diagnosis;
}

}  // namespace gs
