// SPDX-License-Identifier: Apache-2.0
// How many instances the next frame will have, from the frames before it. With such a number the
// CUDA renderer launches a whole frame at once: it does not wait for the count in between.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>

namespace gs {

/// Frames of the same size and of as many Gaussians follow each other on a camera's path.
struct FrameKind {
  int width = 0, height = 0;  // pixels
  std::size_t gaussians = 0;
  bool operator==(const FrameKind&) const = default;
};

/// Remembers the counts of the latest frames of a few kinds. A frame with more instances than its
/// capacity has to be drawn again, and a larger capacity costs time in the sort. Capacities
/// therefore follow the last change between two frames, and after a jump there is none.
class FrameForecast {
 public:
  /// The number of instances for which the next frame of this kind reserves places. 0: it must be
  /// counted, because fewer than two frames were seen or the last two differ too much.
  std::uint32_t capacity_for(const FrameKind& kind) const;
  /// The number of instances that a frame of this kind had.
  void note(const FrameKind& kind, std::uint32_t instances);

 private:
  struct Seen {
    FrameKind kind;
    std::uint32_t before_last, last;
    bool has_two;
  };
  std::deque<Seen> seen_;  // the kind that was seen last is at the front
};

}  // namespace gs
