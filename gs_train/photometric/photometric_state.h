// SPDX-License-Identifier: Apache-2.0
// The numbers that a photometric model learns, part of TrainingModel, and where a device finds
// those of one photo.
#pragma once

#include "gs_train/photo_table.h"

namespace gs {

/// A row for each training photo, in the order of the scene.
struct PhotometricState : PhotoTable {
  bool is_solved = false;  // the start was solved for, so that values are pulled to it

  using PhotoTable::PhotoTable;
};

/// What a device needs of the state to show a picture as one photo does. All numbers are in the
/// memory of the device, so that no step waits for them.
struct PhotoOnDevice {
  const float* photo;  // (numbers)
  // += weight * dL/d(numbers), by the loss; null: the numbers rest
  double* photo_gradient = nullptr;
  double weight = 1;
};

/// Calls f(name, a.array, b.array, ...) for each array. Checkpoints name their sections like this.
template <class F, class First, class... Rest>
void for_each_photometric_array(F&& f, First&& first, Rest&&... rest) {
  f("photometric.values", first.values, rest.values...);
  f("photometric.moments", first.moments, rest.moments...);
  f("photometric.start", first.start, rest.start...);
}

/// A copy in another memory.
inline PhotometricState copy_to(Memory& memory, const PhotometricState& from) {
  PhotometricState state(memory);
  copy_table(from, state);
  state.is_solved = from.is_solved;
  return state;
}

}  // namespace gs
