// SPDX-License-Identifier: Apache-2.0
// Moments that are codes as floats, to be compared.
#pragma once

#include "gs_train/training_model.h"

namespace gs {

/// The same model in host memory, with codes as moments of floats.
inline TrainingModel decoded(const TrainingModel& from) {
  TrainingModel model = copy_to(host_memory(), from);
  if (model.moment_form == MomentForm::floats) return model;
  model.first_moment.resize(model.count());
  model.second_moment.resize(model.count());
  for_each_array(
      [](const char*, const auto& m, const auto& v, const auto& moments) {
        const Span<TinyCode> codes = codes_of(moments);
        for (std::size_t i = 0; i < codes.size; ++i) {
          numbers_of(m)[i] = first_moment(codes[i]);
          numbers_of(v)[i] = second_moment(codes[i]);
        }
      },
      model.first_moment, model.second_moment, model.codes);
  model.moment_form = MomentForm::floats;
  return model;
}

}  // namespace gs
