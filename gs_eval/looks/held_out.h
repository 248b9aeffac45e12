// SPDX-License-Identifier: Apache-2.0
// The numbers of photos that nobody trained on, predicted from those of training photos without a look
// at a pixel.
#pragma once

#include <string>
#include <vector>

#include "gs_core/scene.h"
#include "gs_train/photometric/photometric_state.h"

namespace gs {

/// A rule that predicts a photo's numbers, and how well it does.
struct HeldOutRule {
  std::string name;
  double spread = 0;  // of its errors, as a root mean square, where each training photo is left out
};

struct HeldOutPhotos {
  std::vector<HeldOutRule> rules;           // all that were tried
  std::string rule;                         // of the least spread
  std::vector<std::vector<float>> numbers;  // (test views) by that rule
};

/// The rules:
///   mean       the mean of all training photos of the same camera
///   neighbors  between the photos before and after it, by name, of the same camera
///   nearest    the mean of the four photos of the same camera that were taken nearest to it
///   exif       the line of least squares from EXIF's exposure to each number, of the same camera;
///              tried where photos have it, and for others the mean
/// The one that predicts each training photo best from the others predicts the test views. Where a
/// camera took no training photo, all cameras count. The state is in host memory.
HeldOutPhotos predict_held_out(const PhotometricState& state, const Scene& scene);

}  // namespace gs
