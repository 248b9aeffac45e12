// SPDX-License-Identifier: Apache-2.0
// Everything that training changes.
#pragma once

#include "gs_core/model_rows.h"
#include "gs_train/photometric/photometric_state.h"
#include "gs_train/poses/pose_state.h"

namespace gs {

/// A model in training: its rows, what it learns of photos, and how far it is.
struct TrainingModel : ModelRows {
  PhotometricState photometric;  // of the photos; empty without photometric.model
  PoseState poses;               // of the photos; empty without poses.refine
  // updates since the start; one count for all Gaussians, as in Kerbl et al. 2023
  int adam_steps = 0;
  // Gaussians before the first step; a growth curve begins there. 0: not known
  std::size_t first_count = 0;

  explicit TrainingModel(Memory& memory = host_memory())
      : ModelRows(memory), photometric(memory), poses(memory) {}
};

/// Sets moments and statistics to zero, as before the first step. The parameters must be set.
inline void clear_history(TrainingModel& model) {
  const std::size_t count = model.count();
  model.match_moments();
  for (const Column& column : model.columns())
    if (column.role != RowRole::parameter) {
      column.rows->resize(count);
      column.rows->fill_zero();
    }
  model.adam_steps = 0;
  model.first_count = count;
}

/// A copy of everything, in another memory.
inline TrainingModel copy_to(Memory& memory, const TrainingModel& from) {
  TrainingModel model(memory);
  model.match_columns(from);
  copy_columns(from.columns(), model.columns());
  model.photometric = copy_to(memory, from.photometric);
  model.poses = copy_to(memory, from.poses);
  model.adam_steps = from.adam_steps;
  model.first_count = from.first_count;
  return model;
}

}  // namespace gs
