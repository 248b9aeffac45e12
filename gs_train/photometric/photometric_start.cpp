// SPDX-License-Identifier: Apache-2.0
#include "gs_train/photometric/photometric_start.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_core/error.h"

namespace gs {
namespace {

// A mode for each number: all photos alike.
void set_modes(PhotometricState& state) {
  std::vector<double> modes(state.numbers * state.size(), 0.0);
  for (std::size_t k = 0; k < state.numbers; ++k)
    for (std::size_t row = 0; row < state.rows; ++row)
      modes[k * state.size() + state.begin_of(row) + k] = 1;
  state.modes.upload(modes);
  state.mode_length2 = double(state.rows);
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
      model.start_from_gains(Vec3f(gain), state.row(i));
    }
}

PhotometricState start_of(const PhotometricModel& model, std::size_t numbers, const Scene& scene) {
  const std::vector<View>& views = scene.train_views;
  PhotometricState state;
  state.begin(views.size(), numbers);
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (!views[i].has_exposure()) continue;
    model.start_from_gains(views[i].exposure, state.row(i));
    state.is_solved = true;
  }
  if (!state.is_solved) start_from_stops(model, views, state);
  set_modes(state);
  take_out_modes(state);
  std::copy(state.values.begin(), state.values.end(), state.start.begin());
  return state;
}

}  // namespace

void begin_photometric(const Config& config, const Scene& scene, TrainingModel& model) {
  const auto photometric = make_photometric_model(config.photometric);
  if (!photometric) return;
  PhotometricState& state = model.photometric;
  const std::size_t photos = scene.train_views.size(), numbers = photometric->photo_names().size();
  if (state.empty()) {
    state = copy_to(model.gaussians.memory(), start_of(*photometric, numbers, scene));
    return;
  }
  if (state.rows != photos || state.numbers != numbers)
    throw Error(
        fmt::format("the state of the run has {} photos of photometric.model, but {} has {}; train "
                    "on the scene of the run, or start a new run in another folder (-o)",
                    state.rows, scene.source, photos));
  set_modes(state);
}

float stops_gain(float stops) { return std::exp2(kGainOfStop * stops); }

}  // namespace gs
