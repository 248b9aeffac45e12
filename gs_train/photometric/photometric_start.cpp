// SPDX-License-Identifier: Apache-2.0
#include "gs_train/photometric/photometric_start.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "gs_core/error.h"

namespace gs {
namespace {

PhotometricShape shape_of(const PhotometricModel& model, const std::vector<View>& views) {
  PhotometricShape shape;
  shape.photos = std::uint32_t(views.size());
  shape.photo_size = std::uint32_t(model.photo_names().size());
  shape.camera_size = std::uint32_t(model.camera_names().size());
  for (const std::uint32_t row : camera_rows(views))
    shape.cameras = std::max(shape.cameras, row + 1);
  return shape;
}

// Photos without the tags start as the mean of the others.
void start_from_stops(const PhotometricModel& model, const std::vector<View>& views,
                      PhotometricState& state) {
  double sum = 0, count = 0;
  for (const View& view : views)
    if (view.exposure_stops) sum += double(*view.exposure_stops), ++count;
  for (std::size_t i = 0; i < views.size(); ++i)
    if (views[i].exposure_stops) {
      const float gain = stops_gain(*views[i].exposure_stops - float(sum / count));
      model.start_from_gains(Vec3f(gain), state.photo(i));
    }
}

PhotometricState start_of(const PhotometricModel& model, const PhotometricShape& shape,
                          const Scene& scene) {
  const std::vector<View>& views = scene.train_views;
  PhotometricState state;
  state.shape = shape;
  state.camera_of = camera_rows(views);
  for_each_photometric_array(
      [&](const char*, auto& array) {
        array.resize(shape.size());
        array.fill_zero();
      },
      state);
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (!views[i].has_exposure()) continue;
    model.start_from_gains(views[i].exposure, state.photo(i));
    state.is_solved = true;
  }
  if (!state.is_solved) start_from_stops(model, views, state);
  for (std::size_t i = 0; i < views.size(); ++i)
    if (const auto lens = scene.lenses.find(views[i].camera_id); lens != scene.lenses.end())
      model.start_from_lens(lens->second, state.camera(state.camera_of[i]));
  center_photos(model, state);
  std::copy(state.values.begin(), state.values.end(), state.start.begin());
  return state;
}

}  // namespace

std::vector<std::uint32_t> camera_rows(const std::vector<View>& train_views) {
  std::map<std::uint32_t, std::uint32_t> row_of_id;
  std::vector<std::uint32_t> rows;
  for (const View& view : train_views)
    rows.push_back(
        row_of_id.try_emplace(view.camera_id, std::uint32_t(row_of_id.size())).first->second);
  return rows;
}

void begin_photometric(const Config& config, const Scene& scene, TrainingModel& model) {
  const auto photometric = make_photometric_model(config.photometric);
  if (!photometric) return;
  const PhotometricShape shape = shape_of(*photometric, scene.train_views);
  if (model.photometric.empty()) {
    model.photometric = copy_to(model.gaussians.memory(), start_of(*photometric, shape, scene));
  } else if (!(model.photometric.shape == shape)) {
    throw Error(fmt::format(
        "the state of the run has {} photos and {} cameras of photometric.model, but {} has {} and "
        "{}; train on the scene of the run, or start a new run in another folder (-o)",
        model.photometric.shape.photos, model.photometric.shape.cameras, scene.source, shape.photos,
        shape.cameras));
  } else {
    model.photometric.camera_of = camera_rows(scene.train_views);  // checkpoints do not have it
  }
}

float stops_gain(float stops) { return std::exp2(kGainOfStop * stops); }

void center_photos(const PhotometricModel& model, PhotometricState& state) {
  const std::vector<double> common = model.common_part(state);
  for (std::size_t i = 0; i < state.shape.photos; ++i)
    for (std::size_t k = 0; k < common.size(); ++k) {
      float& value = state.photo(i)[k];
      value = float(double(value) - common[k]);
    }
}

}  // namespace gs
