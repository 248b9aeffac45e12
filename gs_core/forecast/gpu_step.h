// SPDX-License-Identifier: Apache-2.0
// What a training step on a GPU keeps with a row per Gaussian. The CUDA backend allocates these
// arrays, and the forecast of memory (training_memory.h) counts them.
#pragma once

#include <algorithm>
#include <vector>

#include "gs_core/buffer.h"
#include "gs_core/math/density/growth.h"
#include "gs_core/math/render/splat.h"

namespace gs {

/// Instances of a list that one warp takes in the backward pass. Each pixel has a checkpoint, color
/// and transmittance, between two segments.
inline constexpr std::uint32_t kSegmentLength = 512;
/// Places for instances that a step takes at least, before any view was seen.
inline constexpr std::size_t kLeastCapacity = std::size_t(1) << 20;
// Times the most instances per Gaussian of any view seen so far: of up to kFewGaussians, and of more.
inline constexpr double kUnseenMargin = 1.5, kUnseenMarginOfMany = 1.25;
inline constexpr std::size_t kFewGaussians = 1'000'000;

/// Places for a view's instances before any view was seen. Few Gaussians are large ones. A view that
/// has more instances is launched again, which costs less than memory that no view needs.
constexpr double first_capacity(std::size_t gaussians) {
  const double few = double(std::min(gaussians, kFewGaussians)), others = double(gaussians) - few;
  return std::max(double(kLeastCapacity), 4 * few + others);
}
/// Times the most instances per Gaussian of any view, for a view that was not seen yet.
constexpr double unseen_margin(std::size_t gaussians) {
  return gaussians > kFewGaussians ? kUnseenMarginOfMany : kUnseenMargin;
}
/// Places that a step has once it has seen all views of Gaussians that do not change. The view with
/// most instances has `most_instances`, and is not the last one that was seen.
constexpr double capacity_of_views(std::size_t gaussians, double most_instances) {
  return std::max(first_capacity(gaussians), unseen_margin(gaussians) * most_instances);
}

/// Pictures with fewer tiles have numbers of tiles of 16 bits.
inline constexpr std::size_t kShortKeyTiles = 65536;
/// What an instance takes until it is sorted by tile: its Gaussian, and its tile twice.
constexpr std::size_t unsorted_bytes(bool has_short_keys) {
  return sizeof(std::uint32_t) +
         2 * (has_short_keys ? sizeof(std::uint16_t) : sizeof(std::uint32_t));
}

/// dL/d(splat) of one Gaussian: three vectors of four floats, so that a warp adds its share with
/// three atomic additions.
struct alignas(16) SplatGradientSum {
  Vec2f mean2d;
  float conic_xx, conic_xy;
  float conic_yy, opacity, red, green;
  // absolute: |dL/d(mean2d)|, where asked for; else count and second of FragmentSums for the score
  // "force" (sums_among_gradients() in stages.cuh)
  float blue, absolute_x, absolute_y;
  float depth;  // where depths are blended
};

/// Count of numbers in a SplatGradientSum: without the absolute gradient, with it, and with the depth.
inline constexpr int kGradientNumbers = 9, kAbsoluteNumbers = 11, kAllGradientNumbers = 12;

/// The sums as integer multiples of kFine. A share x is split into a multiple of kCoarse, which is
/// rarely not zero and goes to CoarseSums, and the rest, which goes here. The rest is below 2^42
/// kFine, so that 2^21 shares can be added; a Gaussian gets at most one share from each sub-tile.
/// The rounding error, 2^-57, is far below Adam's epsilon.
struct alignas(16) FineSums {
  static constexpr float kFine = 0x1p-56f, kCoarse = 0x1p-14f;
  static constexpr float kMost = 0x1p40f;  // of a share; larger ones, and NaN, make the sum NaN
  long long numbers[kAllGradientNumbers];
  unsigned has_coarse, is_broken;
};
struct CoarseSums {
  long long numbers[kAllGradientNumbers];
};

/// FragmentSums in multiples of kUnit, so that the result does not depend on the order of
/// additions. Forces are those of the loss times its 3 H W values: those of the mean loss are so
/// small in a photo of usual size that their squares would round to zero. A share that is not below
/// kMost counts as nothing.
struct FixedFragmentSums {
  static constexpr float kUnit = 0x1p-36f, kMost = 0x1p24f;
  long long numbers[3];
};

/// Which sums a step makes for each Gaussian.
struct StepSums {
  bool forces = false;         // over fragments, for the score "force"
  bool deterministic = false;  // in fixed point
  bool absolute = false;       // of gradients of means
  bool with_depths = false;    // for photos with a depth map

  /// True where the forces find room in SplatGradientSum.
  bool forces_among_gradients() const {
    return forces && !deterministic && !absolute && !with_depths;
  }
};

/// The arrays of a photo, which outlive its pass until all photos of a batch are drawn.
struct PhotoArrays {
  Buffer<Splat> splats;                           // (N)
  Buffer<Rect> pixel_rects;                       // (N)
  Buffer<std::uint32_t> tile_counts, depth_keys;  // (N)
  // Zero between steps.
  Buffer<SplatGradientSum> gradients;             // (N)
  Buffer<Vec4f> fragment_sums;                    // (N)  forces where they are not among gradients
  Buffer<FixedFragmentSums> fixed_fragment_sums;  // (N)  forces in fixed point

  explicit PhotoArrays(Memory& memory = host_memory())
      : splats(memory), pixel_rects(memory), tile_counts(memory), depth_keys(memory),
        gradients(memory), fragment_sums(memory), fixed_fragment_sums(memory) {}
  /// The arrays that row operations borrow between steps.
  std::vector<ByteBuffer*> borrowed() { return {&splats, &pixel_rects}; }
  /// The others that a step with these sums has.
  std::vector<ByteBuffer*> others(const StepSums& sums) {
    std::vector<ByteBuffer*> all{&tile_counts, &depth_keys, &gradients};
    if (sums.forces && sums.deterministic) all.push_back(&fixed_fragment_sums);
    if (sums.forces && !sums.deterministic && !sums.forces_among_gradients())
      all.push_back(&fragment_sums);
    return all;
  }
};

}  // namespace gs
