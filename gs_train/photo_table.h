// SPDX-License-Identifier: Apache-2.0
// What a run learns of its training photos, as numbers: their gains (photometric/) and their poses
// (poses/) are such tables. One update serves both; its GPU twin is cuda/photo_terms/photo_table.cu.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "gs_core/buffer.h"
#include "gs_core/math/update/adam.h"
#include "gs_core/math/update/adam_moments.h"

namespace gs {

/// Numbers that a row has at most.
inline constexpr std::size_t kMostPhotoNumbers = 6;

/// How strongly a number is pulled towards the value that it began with (pull_vjp()). A weight of 0
/// is no pull.
struct PhotoPull {
  double weight = 0, spread = 1;
};
/// That of each number of a row.
using PhotoPulls = std::array<PhotoPull, kMostPhotoNumbers>;

/// A row of numbers for each training photo, or for the photos that share one. The arrays lie in the
/// memory of the model.
struct PhotoTable {
  std::uint32_t rows = 0, numbers = 0;  // numbers of each row
  Buffer<float> values;                 // (rows, numbers)
  Buffer<FloatMoments> moments;         // (rows, numbers) of Adam
  Buffer<float> start;                  // (rows, numbers) the values that the pull leads to
  // (modes, rows, numbers) directions of all values together, at right angles to each other. Photos
  // do not decide how far the values go along them, so every update takes that out. They follow from
  // the scene, and checkpoints do not have them.
  Buffer<double> modes;
  double mode_length2 = 1;  // of each mode: the sum of its squares
  int adam_steps = 0;       // updates; fewer than the model's, because tables rest at times

  explicit PhotoTable(Memory& memory = host_memory())
      : values(memory), moments(memory), start(memory), modes(memory) {}
  bool empty() const { return values.empty(); }
  std::size_t size() const { return std::size_t(rows) * numbers; }
  std::size_t mode_count() const { return empty() ? 0 : modes.size() / size(); }
  std::size_t begin_of(std::size_t row) const { return row * numbers; }
  Span<float> row(std::size_t row) const { return {values.data() + begin_of(row), numbers}; }

  /// Becomes a table of zeros.
  void begin(std::size_t row_count, std::size_t number_count);
};

/// Makes `to` a copy, in its own memory.
void copy_table(const PhotoTable& from, PhotoTable& to);

/// One update of all rows, also of those whose photos the step did not show: their moments move them
/// on. In host memory.
///
/// gradient   (rows, numbers) that of the data; the gradient of the pull is added to it
void update_table(PhotoTable& table, const PhotoPulls& pulls, float rate, const AdamRule& rule,
                  std::vector<double>& gradient);

/// Takes out of the values what lies along the modes, by least squares: what all photos have in
/// common is the scene's. In host memory.
void take_out_modes(PhotoTable& table);

}  // namespace gs
