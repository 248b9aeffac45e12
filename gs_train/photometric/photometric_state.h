// SPDX-License-Identifier: Apache-2.0
// The numbers that a photometric model learns, part of TrainingModel, and where a device finds
// those of one photo.
#pragma once

#include <cstdint>

#include "gs_core/buffer.h"
#include "gs_core/math/update/adam_moments.h"

namespace gs {

/// How many photos there are, and how many numbers each of them has.
struct PhotometricShape {
  std::uint32_t photos = 0, photo_size = 0;

  std::size_t size() const { return std::size_t(photos) * photo_size; }
  std::size_t photo_begin(std::size_t photo) const { return photo * photo_size; }
  bool operator==(const PhotometricShape&) const = default;
};

/// All arrays have shape.size() rows: those of the training photos, in the order of the scene.
struct PhotometricState {
  PhotometricShape shape;
  Buffer<float> values;
  Buffer<FloatMoments> moments;  // of Adam
  Buffer<float> start;           // that the values began with
  int adam_steps = 0;      // updates; fewer than the model's, because the values rest at times
  bool is_solved = false;  // the start was solved for, so that values stay near it

  explicit PhotometricState(Memory& memory = host_memory())
      : values(memory), moments(memory), start(memory) {}
  bool empty() const { return values.empty(); }
  Span<float> photo(std::size_t i) const {
    return {values.data() + shape.photo_begin(i), shape.photo_size};
  }
};

/// What a device needs of the state to show a picture as one photo does. All numbers are in the
/// memory of the device, so that no step waits for them.
struct PhotoOnDevice {
  const float* photo;  // (shape.photo_size)
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
  state.shape = from.shape;
  state.adam_steps = from.adam_steps;
  state.is_solved = from.is_solved;
  for_each_photometric_array(
      [](const char*, auto& to, const auto& array) { to.upload(array.download()); }, state, from);
  return state;
}

}  // namespace gs
