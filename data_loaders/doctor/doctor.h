// SPDX-License-Identifier: Apache-2.0
// What is right and wrong with a scene before any training: `gemsplat doctor`.
#pragma once

#include <string>
#include <vector>

#include "data_loaders/scene/load_scene.h"

namespace gs {

/// One thing that was looked at.
struct Finding {
  enum class Level {
    good,     // as it should be
    note,     // nothing wrong, but worth knowing
    warning,  // training starts, and its result may suffer
    fatal,    // training cannot start
  };
  Level level;
  std::string topic;               // scene, model, lenses, photos, masks, orientation, pictures, cameras, points, place, forecast
  std::string text;                // plain words, the remedy included
  std::vector<std::string> names;  // the photos that it is about, all of them
};

struct Diagnosis {
  std::vector<Finding> findings;  // in the order of the topics
  bool can_train() const;
};

/// Looks at all that load_scene() would use, without stopping at the first trouble. With `look_at_pictures` every photo
/// is decoded, too, for sharpness and brightness; `progress` counts those.
Diagnosis examine(const Config& config, bool look_at_pictures, const ProgressFn& progress = {});

}  // namespace gs
