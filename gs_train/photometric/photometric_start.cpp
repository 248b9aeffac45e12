// SPDX-License-Identifier: Apache-2.0
#include "gs_train/photometric/photometric_start.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_core/error.h"

namespace gs {
namespace {

PhotometricShape shape_of(const PhotometricModel& model, const std::vector<View>& views) {
  return {std::uint32_t(views.size()), std::uint32_t(model.photo_names().size())};
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
  center_photos(model, state);
  std::copy(state.values.begin(), state.values.end(), state.start.begin());
  return state;
}

}  // namespace

void begin_photometric(const Config& config, const Scene& scene, TrainingModel& model) {
  const auto photometric = make_photometric_model(config.photometric);
  if (!photometric) return;
  const PhotometricShape shape = shape_of(*photometric, scene.train_views);
  if (model.photometric.empty()) {
    model.photometric = copy_to(model.gaussians.memory(), start_of(*photometric, shape, scene));
  } else if (!(model.photometric.shape == shape)) {
    throw Error(
        fmt::format("the state of the run has {} photos of photometric.model, but {} has {}; train "
                    "on the scene of the run, or start a new run in another folder (-o)",
                    model.photometric.shape.photos, scene.source, shape.photos));
  }
}

float stops_gain(float stops) { return std::exp2(kGainOfStop * stops); }

void update_photometric(PhotometricState& state, const PhotometricModel& model, float rate,
                        const AdamRule& rule, std::vector<double>& gradient) {
  GS_CHECK(gradient.size() == state.values.size());
  model.add_penalties(state, gradient);
  const AdamStep step = adam_step(state.adam_steps += rule.steps, rate);
  for (std::size_t i = 0; i < gradient.size(); ++i)
    adam_update(state.values[i], state.moments[i], float(gradient[i]), step, rule);
  center_photos(model, state);
}

void center_photos(const PhotometricModel& model, PhotometricState& state) {
  const std::vector<double> common = model.common_part(state);
  for (std::size_t i = 0; i < state.shape.photos; ++i)
    for (std::size_t k = 0; k < common.size(); ++k) {
      float& value = state.photo(i)[k];
      value = float(double(value) - common[k]);
    }
}

}  // namespace gs
