// SPDX-License-Identifier: Apache-2.0
// The appearances of all photos of a scene: learned ones of training photos, predicted ones of others.
// photometric.json holds them.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "gs_core/config/config.h"
#include "gs_eval/looks/held_out.h"
#include "gs_train/photometric/photometric_model.h"

namespace gs {

struct PhotoLook {
  std::uint32_t camera_id = 0;
  bool is_held_out = false;
  std::vector<float> numbers;  // PhotometricModel::photo_names()
};

struct SceneLooks {
  PhotometricConfig config;
  std::map<std::string, PhotoLook> photos;  // by name
  std::vector<HeldOutRule> rules;           // as in HeldOutPhotos
  std::string rule;
};

/// The appearances that a run has learned; the state may be in any memory.
SceneLooks looks_of(const PhotometricConfig& config, const PhotometricState& state,
                    const Scene& scene);

/// Gives the appearance of a view's photo, by its name. Null for a photo that is not known.
using AppearanceOf = std::function<std::unique_ptr<Appearance>(const View&)>;
AppearanceOf appearances(const SceneLooks& looks);

/// Appearances under the exposures of the scene's views, which were solved for, in place of the
/// learned or predicted numbers. Null for a photo without an exposure. Learned
/// numbers differ from the solved ones by a common part, which is that of the training photos.
AppearanceOf solved_appearances(const SceneLooks& looks, const Scene& scene);

}  // namespace gs
