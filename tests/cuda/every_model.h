// SPDX-License-Identifier: Apache-2.0
// What tests of updates on the GPU share: models of every form, views of them, and an update with a
// learning rate for every quantity.
#pragma once

#include "gs_train/update.h"
#include "tests/support/cuda.h"

namespace gs {

/// Rates of all quantities, also of time.
inline LearningRates all_rates() {
  LearningRates rates{1e-4f, 5e-3f, 1e-3f, 2.5e-2f, 2.5e-3f, 1.25e-4f};
  rates.right_rotation = rates.rotation;
  rates.time_mean = 8e-4f;
  rates.log_time_scale = 5e-3f;
  return rates;
}

inline Update update_of(int photos = 1) {
  Update update{all_rates(), batch_rule(photos)};
  update.rounding_seed = 11;
  return update;
}

/// Views of consecutive moments, each `shift` pixels beside the one before. If `is_centered`, the
/// middle one looks straight ahead; else the first one does.
inline std::vector<View> shifted_views(int count, int shift, bool is_centered) {
  std::vector<View> views(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    View& view = views[std::size_t(i)];
    view.name = "view " + std::to_string(i);
    view.camera = random_camera(131, 77, 1);
    view.camera.cx += float(shift * (is_centered ? i - count / 2 : i));
    view.camera.time = 0.4f + 0.1f * float(i);
    view.photo = random_photo(131, 77, std::uint64_t(i));
  }
  return views;
}

/// Gaussians in 3D, with a 3D filter, and in space and time.
inline std::vector<Gaussians> all_forms(const Camera& camera = random_camera(131, 77, 1),
                                        std::size_t count = 3000) {
  std::vector<Gaussians> forms;
  const auto plain = [&] { return random_gaussians(kTypical, count, camera, 4); };
  forms.push_back(plain());
  forms.push_back(with_filters(plain(), 9));
  forms.push_back(in_spacetime(plain(), 8));
  return forms;
}

}  // namespace gs
