// SPDX-License-Identifier: Apache-2.0
// Training models with the numbers of photometric.model, for tests of single steps.
#pragma once

#include "gs_train/photometric/photometric_start.h"
#include "tests/support/adaptive.h"
#include "tests/support/scenes.h"

namespace gs {

/// Gives a model the numbers of these views: gains of up to a quarter of a stop.
inline void begin_with_gains(const PhotometricConfig& photometric, const std::vector<View>& views,
                             TrainingModel& model) {
  Config config = adaptive_config();
  config.photometric = photometric;
  Scene scene;
  scene.train_views = views;
  begin_photometric(config, scene, model);
  PhotometricState& state = model.photometric;
  Draws draws(21);
  for (std::size_t i = 0; i < state.size(); ++i) state.values[i] = draws.uniform(-0.2f, 0.2f);
  take_out_modes(state);
}

}  // namespace gs
