// SPDX-License-Identifier: Apache-2.0
// `gemsplat doctor`: the faults of a scene, found before any training.
#pragma once

#include <string>
#include <vector>

#include "data_loaders/doctor/forecast.h"
#include "data_loaders/scene/load_scene.h"

namespace gs {

/// The result of one check.
struct Finding {
  enum class Level {
    good,     // as it should be
    note,     // nothing wrong, but worth knowing
    warning,  // training starts, and its result may suffer
    fatal,    // training cannot start
  };
  Level level;
  // scene, model, lenses, photos, masks, orientation, pictures, cameras, points, sight, place,
  // depth, forecast, blocks, light
  std::string topic;
  std::string text;                // plain words, with the remedy
  std::vector<std::string> names;  // of all photos concerned
};

struct Diagnosis {
  std::vector<Finding> findings;  // in the order of the topics
  bool can_train() const;
};

/// Checks everything that load_scene() would use, without stopping at the first fault; of photos
/// without camera poses, what can be said before COLMAP runs. With
/// `look_at_pictures` every photo is decoded as well, to compare sharpness, brightness and light;
/// `progress` counts these. `device` is the one that the run would use.
Diagnosis examine(const Config& config, bool look_at_pictures, const ProgressFn& progress = {},
                  const ForecastDevice& device = {});

}  // namespace gs
