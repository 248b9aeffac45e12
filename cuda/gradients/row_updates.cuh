// SPDX-License-Identifier: Apache-2.0
// The last step of stages 7 and 8 for the 32 rows of a warp: the gradients are written to arrays,
// or Adam updates the parameters with them. The whole warp takes the numbers of a quantity in the
// order of its array, so that it reads and writes whole cache lines. A lane therefore mostly
// handles numbers of other lanes' Gaussians.
#pragma once

#include <type_traits>

#include "cuda/gradients/number_updates.cuh"
#include "cuda/render/sh_rows.cuh"
#include "cuda/stages.cuh"
#include "gs_core/math/density/density.h"
#include "gs_core/math/density/spacetime_regularizer.h"

namespace gs::cuda {

/// The learned quantities in the order of for_each_array(). Those of time come last.
struct Quantity {
  enum Name : int {
    mean,
    log_scale,
    rotation,
    logit_opacity,
    sh0,
    sh_rest,
    right_rotation,
    time_mean,
    log_time_scale,
    count
  };
};
/// Numbers of a row before those of a quantity. Rows of sh_rest are handled apart from all others.
constexpr int offset_of(int quantity) {
  constexpr int kOffsets[Quantity::count + 1] = {0, 3, 6, 10, 11, 14, 14, 18, 19, 20};
  return kOffsets[quantity];
}
constexpr int width_of(int quantity) { return offset_of(quantity + 1) - offset_of(quantity); }
template <bool has_time>
inline constexpr int kQuantities = has_time ? int(Quantity::count) : int(Quantity::sh_rest);
template <bool has_time>
inline constexpr int kRowNumbers = offset_of(kQuantities<has_time>);

/// Calls f(std::integral_constant<int, quantity>) for each quantity of a row, without sh_rest.
template <bool has_time, int quantity = 0, class F>
__device__ void for_each_quantity(F&& f) {
  if constexpr (quantity < kQuantities<has_time>) {
    if constexpr (width_of(quantity) > 0) f(std::integral_constant<int, quantity>());
    for_each_quantity<has_time, quantity + 1>(f);
  }
}

/// The numbers of one row without sh_rest: parameters, or their gradients.
template <bool has_time>
struct Row {
  float numbers[kRowNumbers<has_time>] = {};

  __device__ float number(int quantity) const { return numbers[offset_of(quantity)]; }
  __device__ Vec3f vector(int quantity) const {
    const int at = offset_of(quantity);
    return {numbers[at], numbers[at + 1], numbers[at + 2]};
  }
  __device__ Quatf quaternion(int quantity) const {
    const int at = offset_of(quantity);
    return {numbers[at], numbers[at + 1], numbers[at + 2], numbers[at + 3]};
  }
  __device__ void set(int quantity, float number) { numbers[offset_of(quantity)] = number; }
  __device__ void set(int quantity, const Vec3f& vector) {
    for (int c = 0; c < 3; ++c) numbers[offset_of(quantity) + c] = vector[c];
  }
  __device__ void set(int quantity, const Quatf& q) {
    const int at = offset_of(quantity);
    numbers[at] = q.w;
    numbers[at + 1] = q.x;
    numbers[at + 2] = q.y;
    numbers[at + 3] = q.z;
  }

  /// All but the color, of Gaussians in space and time.
  __device__ SpacetimeShape<float> in_spacetime() const {
    static_assert(has_time);
    return {vector(Quantity::mean),
            vector(Quantity::log_scale),
            {quaternion(Quantity::rotation), quaternion(Quantity::right_rotation)},
            number(Quantity::logit_opacity),
            number(Quantity::time_mean),
            number(Quantity::log_time_scale)};
  }
  __device__ void take(const SpacetimeShape<float>& shape) {
    static_assert(has_time);
    set(Quantity::mean, shape.mean);
    set(Quantity::log_scale, shape.log_scale);
    set(Quantity::rotation, shape.rotations.left);
    set(Quantity::right_rotation, shape.rotations.right);
    set(Quantity::logit_opacity, shape.logit_opacity);
    set(Quantity::time_mean, shape.time_mean);
    set(Quantity::log_time_scale, shape.log_time_scale);
  }
  __device__ void add(const GaussianShape<float>& shape) {
    set(Quantity::mean, vector(Quantity::mean) + shape.mean);
    set(Quantity::log_scale, vector(Quantity::log_scale) + shape.log_scale);
    const Quatf q = quaternion(Quantity::rotation), r = shape.rotation;
    set(Quantity::rotation, Quatf{q.w + r.w, q.x + r.x, q.y + r.y, q.z + r.z});
  }
  __device__ void take(const GaussianGradient<float>& gradient) {
    set(Quantity::mean, gradient.mean);
    set(Quantity::log_scale, gradient.log_scale);
    set(Quantity::rotation, gradient.rotation);
    set(Quantity::logit_opacity, gradient.logit_opacity);
  }
};

/// Where the numbers of a warp's rows lie in shared memory: each quantity row after row, as it lies
/// in its array. Calls f(its number within a row, its index) for each number of this lane's row.
template <bool has_time, class F>
__device__ void for_each_number(F&& f) {
  for_each_quantity<has_time>([&](auto quantity) {
    constexpr int kWidth = width_of(quantity), kOffset = offset_of(quantity);
    for (int c = 0; c < kWidth; ++c)
      f(kOffset + c, kOffset * kWarp + lane_of_thread() * kWidth + c);
  });
}
template <bool has_time>
__device__ Row<has_time> row_from(const float* shared) {
  Row<has_time> row;
  for_each_number<has_time>([&](int number, int at) { row.numbers[number] = shared[at]; });
  return row;
}
template <bool has_time>
__device__ void store_row(float* shared, const Row<has_time>& row) {
  for_each_number<has_time>([&](int number, int at) { shared[at] = row.numbers[number]; });
}

/// A target for the gradients of all quantities: writes them to arrays, and dL/d(mean2d) to another
/// one.
struct WriteGradients {
  using Values = GradientValues;
  Values of[Quantity::count];  // null where rows have no time
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
  __device__ void regularize(const Row<has_time>&, Row<has_time>&) const {}
};
/// The part of a target that gathers the statistics of density control.
struct GatherStatistics {
  float* visits;  // null: no statistics
  float* gradient_norm;
  int width, height;
  const std::uint32_t* halted;
  FragmentSums* force_sums;  // null unless sums_among_gradients()
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
  /// Stages the gradients of several photos at once, of which some show the row.
  __device__ void note_all(std::size_t i, const Statistics& before, float more_visits,
                           float more_norm) const {
    if (!visits || more_visits == 0) return;
    visits[i] = before.visits + more_visits;
    gradient_norm[i] = before.gradient_norm + more_norm;
  }
};
/// A target that updates all parameters.
template <class ValuesOfQuantity>
struct UpdateByAdam : GatherStatistics {
  using Values = ValuesOfQuantity;
  Values of[Quantity::count];  // null where rows have no time
  MomentRounding rounding;     // of HalfMoments
  bool is_absolute;            // the statistic
  bool is_regularized;
  Regularizers of_each;  // weights for one row

  __device__ Vec2f by_mean2d(const SplatGradientSum& sum) const {
    return is_absolute ? Vec2f(sum.absolute_x, sum.absolute_y) : sum.mean2d;
  }
  template <bool has_time>
  __device__ void regularize(const Row<has_time>& row, Row<has_time>& gradient) const {
    if (!is_regularized) return;
    const RegularizerGradient<float> added = regularizer_vjp(
        row.vector(Quantity::log_scale), row.number(Quantity::logit_opacity), of_each);
    gradient.set(Quantity::log_scale, gradient.vector(Quantity::log_scale) + added.log_scale);
    gradient.set(Quantity::logit_opacity,
                 gradient.number(Quantity::logit_opacity) + added.logit_opacity);
    if constexpr (has_time) {
      SpacetimeShape<float> dL = gradient.in_spacetime();
      add_spacetime_regularizer_vjp(row.in_spacetime(), of_each, dL);
      gradient.take(dL);
    }
  }
};

/// This lane's share of the numbers of a warp's rows.
template <bool has_time, class Values>
struct Shares {
  using Stored = typename Values::Stored;
  float parameters[kRowNumbers<has_time>];
  Stored moments[kRowNumbers<has_time>];

  __device__ Shares(const Values* of, std::size_t first, int rows) {
    for_each(
        [&](auto quantity, int k, int item) {
          const std::size_t at = first * width_of(quantity) + item;
          parameters[k] = of[quantity].parameters[at];
          if constexpr (kHasMoments<Stored>) moments[k] = of[quantity].moments[at];
        },
        rows);
  }
  /// The whole warp: returns this lane's row of parameters; the lanes exchange them through shared
  /// memory.
  __device__ Row<has_time> row(float* shared, int rows) const {
    for_each(
        [&](auto quantity, int k, int item) {
          constexpr int kOffset = offset_of(quantity);
          shared[kOffset * kWarp + item] = parameters[k];
        },
        rows);
    __syncwarp();
    const Row<has_time> row = row_from<has_time>(shared);
    __syncwarp();
    return row;
  }
  /// `random` has a word of each row.
  __device__ void finish(const Values* of, std::size_t first, int rows, const float* gradients,
                         const std::uint32_t* random) const {
    for_each(
        [&](auto quantity, int k, int item) {
          constexpr int kWidth = width_of(quantity), kOffset = offset_of(quantity);
          of[quantity].template finish<1>(first * kWidth + item, {parameters[k]}, {moments[k]},
                                          {gradients[kOffset * kWarp + item]},
                                          ValueIndex{random, item / kWidth, item % kWidth, kWidth});
        },
        rows);
  }

 private:
  // Calls f(quantity, which of the lane's numbers, its item of the quantity).
  template <class F>
  static __device__ void for_each(F&& f, int rows) {
    for_each_quantity<has_time>([&](auto quantity) {
      constexpr int kWidth = width_of(quantity), kOffset = offset_of(quantity);
      for (int k = 0; k < kWidth; ++k) {
        const int item = lane_of_thread() + k * kWarp;
        if (item < rows * kWidth) f(quantity, kOffset + k, item);
      }
    });
  }
};

/// An array as plain numbers.
template <class T>
float* numbers_of(const Span<T>& rows) {
  return reinterpret_cast<float*>(rows.data);
}

}  // namespace gs::cuda
