// SPDX-License-Identifier: Apache-2.0
// The last step of stages 7 and 8 for the 32 rows of a warp: the gradients are written to arrays,
// or Adam updates the parameters with them. The whole warp takes the numbers of a quantity in the
// order of its array, so that it reads and writes whole cache lines. A lane therefore mostly
// handles numbers of other lanes' Gaussians.
#pragma once

#include "cuda/render/sh_rows.cuh"
#include "cuda/stages.cuh"
#include "cuda/train/number_updates.cuh"
#include "gs_core/math/density.h"
#include "gs_core/math/spacetime_regularizer.h"

namespace gs::cuda {

/// Parameters or gradients of a warp's rows without SH: each quantity row after row, as it lies in
/// its array.
struct RowNumbers {
  float mean[3 * kWarp], log_scale[3 * kWarp], rotation[4 * kWarp], logit_opacity[kWarp],
      sh0[3 * kWarp];
  // of Gaussians in space and time
  float right_rotation[4 * kWarp], time_mean[kWarp], log_time_scale[kWarp];
};

/// The parameters of one Gaussian without color. Those of time are undefined where it has none.
struct Shape {
  Vec3f mean, log_scale;
  Quatf rotation;
  float logit_opacity;
  Quatf right_rotation;
  float time_mean, log_time_scale;

  __device__ SpacetimeShape<float> in_spacetime() const {
    return {mean, log_scale, {rotation, right_rotation}, logit_opacity, time_mean, log_time_scale};
  }
};

/// The gradients of one row without the SH rest.
struct RowGradient : GaussianGradient<float> {
  Quatf right_rotation{};
  float time_mean = 0, log_time_scale = 0;

  __device__ SpacetimeShape<float> in_spacetime() const {
    return {mean, log_scale, {rotation, right_rotation}, logit_opacity, time_mean, log_time_scale};
  }
  /// Takes all but the color's gradients.
  __device__ void take(const SpacetimeShape<float>& dL) {
    mean = dL.mean;
    log_scale = dL.log_scale;
    rotation = dL.rotations.left;
    right_rotation = dL.rotations.right;
    logit_opacity = dL.logit_opacity;
    time_mean = dL.time_mean;
    log_time_scale = dL.log_time_scale;
  }
};

/// A sink for the gradients of all quantities: writes them to arrays, and dL/d(mean2d) to another
/// one.
struct WriteGradients {
  static constexpr bool kSkipsInvisible = false;
  using Numbers = GradientNumbers;
  Numbers mean, log_scale, rotation, logit_opacity, sh0, sh_rest;
  Numbers right_rotation, time_mean, log_time_scale;  // null where rows have no time
  Vec2f* dL_dmean2d;
  bool is_absolute;  // dL_dmean2d

  struct Statistics {};
  __device__ bool is_halted() const { return false; }
  __device__ Statistics load_statistics(std::size_t) const { return {}; }
  __device__ bool adds_forces() const { return false; }
  __device__ void add_forces(std::size_t, const SplatGradientSum&, float) const {}
  __device__ void note(std::size_t i, const Statistics&, const Vec2f& by_mean2d, bool) const {
    dL_dmean2d[i] = by_mean2d;
  }
  __device__ Vec2f by_mean2d(const SplatGradientSum& sum) const {
    return is_absolute ? Vec2f(sum.absolute_x, sum.absolute_y) : sum.mean2d;
  }
  template <bool has_time>
  __device__ void regularize(const Shape&, RowGradient&) const {}
};
/// The part of a sink that gathers the statistics of density control.
struct GatherStatistics {
  float* visits;  // null: no statistics
  float* gradient_norm;
  int width, height;
  const std::uint32_t* halted;
  FragmentSums* force_sums;  // null unless sums_of_forces_are_added()
  float force_scale;         // of one photo's forces

  struct Statistics {
    float visits = 0, gradient_norm = 0;
  };
  __device__ bool is_halted() const { return *halted != 0; }
  __device__ bool adds_forces() const { return force_sums; }
  __device__ Statistics load_statistics(std::size_t i) const {
    if (!visits) return {};
    return {visits[i], gradient_norm[i]};
  }
  /// Adds a visible row's sums of forces, which lie among its gradients. Nothing waits for these
  /// additions. Each photo makes one for a row, so their order does not matter.
  __device__ void add_forces(std::size_t i, const SplatGradientSum& sum, float opacity) const {
    if (!force_sums || sum.absolute_x == 0) return;
    atomicAdd(&force_sums[i].count, sum.absolute_x);
    atomicAdd(&force_sums[i].first, sum.opacity * opacity * force_scale);  // sum f
    atomicAdd(&force_sums[i].second, sum.absolute_y * (force_scale * force_scale));
  }
  __device__ void note(std::size_t i, const Statistics& before, const Vec2f& by_mean2d,
                       bool is_visible) const {
    if (!visits || !is_visible) return;
    visits[i] = before.visits + 1.0f;
    gradient_norm[i] = before.gradient_norm + screen_gradient_norm(by_mean2d, width, height);
  }
  /// The same for several photos at once, of which some show the row.
  __device__ void note_all(std::size_t i, const Statistics& before, float more_visits,
                           float more_norm) const {
    if (!visits || more_visits == 0) return;
    visits[i] = before.visits + more_visits;
    gradient_norm[i] = before.gradient_norm + more_norm;
  }
};
/// A sink that adds the gradients of one photo of a batch to sums. Rows that are not visible have
/// nothing to add.
struct AddGradients : GatherStatistics {
  static constexpr bool kSkipsInvisible = true;
  using Numbers = SumNumbers;
  Numbers mean, log_scale, rotation, logit_opacity, sh0, sh_rest;
  Numbers right_rotation, time_mean, log_time_scale;  // null where rows have no time
  bool is_absolute;                                   // the statistic
  std::uint32_t* touched;                             // BatchSums

  __device__ Vec2f by_mean2d(const SplatGradientSum& sum) const {
    return is_absolute ? Vec2f(sum.absolute_x, sum.absolute_y) : sum.mean2d;
  }
  template <bool has_time>
  __device__ void regularize(const Shape&, RowGradient&) const {}
};
/// A sink that updates all parameters.
template <class NumbersOfRows>
struct UpdateByAdam : GatherStatistics {
  static constexpr bool kSkipsInvisible = false;
  using Numbers = NumbersOfRows;
  Numbers mean, log_scale, rotation, logit_opacity, sh0, sh_rest;
  Numbers right_rotation, time_mean, log_time_scale;  // null where rows have no time
  bool is_absolute;                                   // the statistic
  bool is_regularized;
  Regularizers of_each;  // weights for one row

  __device__ Vec2f by_mean2d(const SplatGradientSum& sum) const {
    return is_absolute ? Vec2f(sum.absolute_x, sum.absolute_y) : sum.mean2d;
  }
  template <bool has_time>
  __device__ void regularize(const Shape& shape, RowGradient& gradient) const {
    if (!is_regularized) return;
    const RegularizerGradient<float> added =
        regularizer_vjp(shape.log_scale, shape.logit_opacity, of_each);
    gradient.log_scale += added.log_scale;
    gradient.logit_opacity += added.logit_opacity;
    if constexpr (has_time) {
      SpacetimeShape<float> dL = gradient.in_spacetime();
      add_spacetime_regularizer_vjp(shape.in_spacetime(), of_each, dL);
      gradient.take(dL);
    }
  }
};

/// This lane's share of one quantity of a warp's rows, which have kInRow numbers each. `which` is
/// EveryRow or SomeRows; numbers of other rows are neither read nor written.
template <int kInRow, class Numbers>
struct Share {
  float loaded[kInRow][Numbers::kArrays];

  template <class Which>
  __device__ Share(const Numbers& numbers, std::size_t first, int rows, Which which) {
    for (int k = 0; k < kInRow; ++k) {
      const int item = lane_of_thread() + k * kWarp;
      for (int a = 0; a < Numbers::kArrays; ++a)
        if (item < rows * kInRow && which.has(item / kInRow))
          loaded[k][a] = vector_at<Numbers>(numbers.arrays[a], a, first * kInRow + item);
    }
  }
  /// Writes the parameters to `to`, row after row.
  template <class Which>
  __device__ void lay_out(int rows, Which which, float* to) const {
    for (int k = 0; k < kInRow; ++k) {
      const int item = lane_of_thread() + k * kWarp;
      if (item < rows * kInRow && which.has(item / kInRow)) to[item] = loaded[k][0];
    }
  }
  template <class Which, class RandomSource>
  __device__ void finish(const Numbers& numbers, std::size_t first, int rows, Which which,
                         const float* gradients, const RandomSource& random) {
    for (int k = 0; k < kInRow; ++k) {
      const int item = lane_of_thread() + k * kWarp;
      if (item < rows * kInRow && which.has(item / kInRow))
        numbers.finish(first * kInRow + item, loaded[k], gradients[item],
                       NumberPlace<RandomSource>{random, item / kInRow, item % kInRow, kInRow});
    }
  }
};

/// This lane's shares of the quantities of time; none where rows have no time.
template <class Sink, bool has_time>
struct TimeShares {
  using Numbers = typename Sink::Numbers;
  Share<4, Numbers> right_rotation;
  Share<1, Numbers> time_mean, log_time_scale;

  template <class Which>
  __device__ TimeShares(const Sink& sink, std::size_t first, int rows, Which which)
      : right_rotation(sink.right_rotation, first, rows, which),
        time_mean(sink.time_mean, first, rows, which),
        log_time_scale(sink.log_time_scale, first, rows, which) {}
  template <class Which>
  __device__ void lay_out(int rows, Which which, RowNumbers& shared) const {
    right_rotation.lay_out(rows, which, shared.right_rotation);
    time_mean.lay_out(rows, which, shared.time_mean);
    log_time_scale.lay_out(rows, which, shared.log_time_scale);
  }
  __device__ void read(const RowNumbers& shared, int lane, Shape& shape) const {
    const float* const q = shared.right_rotation + 4 * lane;
    shape.right_rotation = {q[0], q[1], q[2], q[3]};
    shape.time_mean = shared.time_mean[lane];
    shape.log_time_scale = shared.log_time_scale[lane];
  }
  template <class Which, class RandomSource>
  __device__ void finish(const Sink& sink, std::size_t first, int rows, Which which,
                         const RowNumbers& gradients, const RandomSource& random) {
    right_rotation.finish(sink.right_rotation, first, rows, which, gradients.right_rotation,
                          random);
    time_mean.finish(sink.time_mean, first, rows, which, gradients.time_mean, random);
    log_time_scale.finish(sink.log_time_scale, first, rows, which, gradients.log_time_scale,
                          random);
  }
};
template <class Sink>
struct TimeShares<Sink, false> {
  template <class Which>
  __device__ TimeShares(const Sink&, std::size_t, int, Which) {}
  template <class Which>
  __device__ void lay_out(int, Which, RowNumbers&) const {}
  __device__ void read(const RowNumbers&, int, Shape&) const {}
  template <class Which, class RandomSource>
  __device__ void finish(const Sink&, std::size_t, int, Which, const RowNumbers&,
                         const RandomSource&) {}
};

/// This lane's shares of all quantities without SH.
template <class Sink, bool has_time>
struct Shares {
  using Numbers = typename Sink::Numbers;
  Share<3, Numbers> mean, log_scale, sh0;
  Share<4, Numbers> rotation;
  Share<1, Numbers> logit_opacity;
  TimeShares<Sink, has_time> time;

  template <class Which>
  __device__ Shares(const Sink& sink, std::size_t first, int rows, Which which)
      : mean(sink.mean, first, rows, which), log_scale(sink.log_scale, first, rows, which),
        sh0(sink.sh0, first, rows, which), rotation(sink.rotation, first, rows, which),
        logit_opacity(sink.logit_opacity, first, rows, which), time(sink, first, rows, which) {}
  /// The whole warp: returns this lane's row of parameters; the lanes exchange them through shared
  /// memory.
  template <class Which>
  __device__ Shape row(RowNumbers& shared, int rows, Which which) const {
    mean.lay_out(rows, which, shared.mean);
    log_scale.lay_out(rows, which, shared.log_scale);
    rotation.lay_out(rows, which, shared.rotation);
    logit_opacity.lay_out(rows, which, shared.logit_opacity);
    time.lay_out(rows, which, shared);
    __syncwarp();
    const int lane = lane_of_thread();
    const auto vector = [&](const float* of) {
      return Vec3f(of[3 * lane], of[3 * lane + 1], of[3 * lane + 2]);
    };
    const float* const q = shared.rotation + 4 * lane;
    Shape shape;
    shape.mean = vector(shared.mean);
    shape.log_scale = vector(shared.log_scale);
    shape.rotation = {q[0], q[1], q[2], q[3]};
    shape.logit_opacity = shared.logit_opacity[lane];
    time.read(shared, lane, shape);
    __syncwarp();
    return shape;
  }
  template <class Which, class RandomSource>
  __device__ void finish(const Sink& sink, std::size_t first, int rows, Which which,
                         const RowNumbers& gradients, const RandomSource& random) {
    mean.finish(sink.mean, first, rows, which, gradients.mean, random);
    log_scale.finish(sink.log_scale, first, rows, which, gradients.log_scale, random);
    sh0.finish(sink.sh0, first, rows, which, gradients.sh0, random);
    rotation.finish(sink.rotation, first, rows, which, gradients.rotation, random);
    logit_opacity.finish(sink.logit_opacity, first, rows, which, gradients.logit_opacity, random);
    time.finish(sink, first, rows, which, gradients, random);
  }
};

__device__ inline void stage_quaternion(float* to, const Quatf& q) {
  to[0] = q.w;
  to[1] = q.x;
  to[2] = q.y;
  to[3] = q.z;
}
/// Writes this lane's row of gradients to shared memory.
template <bool has_time>
__device__ void stage(RowNumbers& to, const RowGradient& gradient) {
  const int lane = lane_of_thread();
  for (int c = 0; c < 3; ++c) {
    to.mean[3 * lane + c] = gradient.mean[c];
    to.log_scale[3 * lane + c] = gradient.log_scale[c];
    to.sh0[3 * lane + c] = gradient.sh0[c];
  }
  stage_quaternion(to.rotation + 4 * lane, gradient.rotation);
  to.logit_opacity[lane] = gradient.logit_opacity;
  if constexpr (has_time) {
    stage_quaternion(to.right_rotation + 4 * lane, gradient.right_rotation);
    to.time_mean[lane] = gradient.time_mean;
    to.log_time_scale[lane] = gradient.log_time_scale;
  }
}

/// An array as plain numbers, or codes as floats of the same bits.
template <class T>
float* numbers_of(const Span<T>& rows) {
  return reinterpret_cast<float*>(rows.data);
}

}  // namespace gs::cuda
