// SPDX-License-Identifier: Apache-2.0
// The last step of stages 7 and 8 for the 32 rows of a warp: the gradients are written to arrays,
// or Adam updates the parameters with them. The whole warp takes the numbers of a quantity in the
// order of its array, so that it reads and writes whole cache lines. A lane therefore mostly
// handles numbers of other lanes' Gaussians.
#pragma once

#include "cuda/stages.cuh"
#include "cuda/warp.cuh"
#include "gs_core/math/density.h"
#include "gs_core/math/splat.h"

namespace gs::cuda {

inline constexpr int kMostArrays = 3;  // of a quantity: the parameters and both moments

/// Parameters or gradients of a warp's rows without SH: each quantity row after row, as it lies in
/// its array.
struct RowNumbers {
  float mean[3 * kWarp], log_scale[3 * kWarp], rotation[4 * kWarp], logit_opacity[kWarp],
      sh0[3 * kWarp];
};

/// The numbers of one quantity, for WriteGradients: finish() writes the gradient to an array.
/// Vector is float or float4.
struct GradientNumbers {
  static constexpr int kArrays = 1;
  float* arrays[kArrays];
  float* gradients;

  template <class Vector>
  __device__ void finish(std::size_t at, Vector (&)[kArrays], const Vector& gradient) const {
    reinterpret_cast<Vector*>(gradients)[at] = gradient;
  }
};

/// The numbers of one quantity, for UpdateByAdam: finish() updates the parameter and its moments.
struct AdamNumbers {
  static constexpr int kArrays = 3;
  float* arrays[kArrays];  // parameters, first and second moments
  AdamStep step;

  template <class Vector>
  __device__ void finish(std::size_t at, Vector (&numbers)[kArrays], const Vector& gradient) const {
    for (int k = 0; k < int(sizeof(Vector) / sizeof(float)); ++k)
      adam_update(reinterpret_cast<float*>(&numbers[0])[k],
                  reinterpret_cast<float*>(&numbers[1])[k],
                  reinterpret_cast<float*>(&numbers[2])[k],
                  reinterpret_cast<const float*>(&gradient)[k], step);
    for (int a = 0; a < kArrays; ++a) reinterpret_cast<Vector*>(arrays[a])[at] = numbers[a];
  }
};

/// The parameters of one Gaussian without color.
struct Shape {
  Vec3f mean, log_scale;
  Quatf rotation;
  float logit_opacity;
};

/// A sink for the gradients of all quantities: writes them to arrays, and dL/d(mean2d) to another
/// one.
struct WriteGradients {
  using Numbers = GradientNumbers;
  Numbers mean, log_scale, rotation, logit_opacity, sh0, sh_rest;
  Vec2f* dL_dmean2d;
  bool is_absolute;  // dL_dmean2d

  struct Statistics {};
  __device__ bool is_halted() const { return false; }
  __device__ Statistics load_statistics(std::size_t) const { return {}; }
  __device__ void note(std::size_t i, const Statistics&, const Vec2f& by_mean2d, bool) const {
    dL_dmean2d[i] = by_mean2d;
  }
  __device__ Vec2f by_mean2d(const SplatGradientSum& sum) const {
    return is_absolute ? Vec2f(sum.absolute_x, sum.absolute_y) : sum.mean2d;
  }
  __device__ void regularize(const Shape&, GaussianGradient<float>&) const {}
};
/// A sink that updates all parameters, and gathers the statistics of density control.
struct UpdateByAdam {
  using Numbers = AdamNumbers;
  Numbers mean, log_scale, rotation, logit_opacity, sh0, sh_rest;
  float* visits;  // null: no statistics
  float* gradient_norm;
  int width, height;
  const std::uint32_t* halted;

  struct Statistics {
    float visits = 0, gradient_norm = 0;
  };
  __device__ bool is_halted() const { return *halted != 0; }
  __device__ Statistics load_statistics(std::size_t i) const {
    if (!visits) return {};
    return {visits[i], gradient_norm[i]};
  }
  __device__ void note(std::size_t i, const Statistics& before, const Vec2f& by_mean2d,
                       bool is_visible) const {
    if (!visits || !is_visible) return;
    visits[i] = before.visits + 1.0f;
    gradient_norm[i] = before.gradient_norm + screen_gradient_norm(by_mean2d, width, height);
  }
  __device__ Vec2f by_mean2d(const SplatGradientSum& sum) const { return sum.mean2d; }
  __device__ void regularize(const Shape&, GaussianGradient<float>&) const {}
};
/// The same with absolute gradients and regularizers. It has a kernel of its own, so that other
/// runs do not pay for it.
struct UpdateByAdamAsAsked : UpdateByAdam {
  bool is_absolute;      // the statistic
  Regularizers of_each;  // weights for one row

  __device__ Vec2f by_mean2d(const SplatGradientSum& sum) const {
    return is_absolute ? Vec2f(sum.absolute_x, sum.absolute_y) : sum.mean2d;
  }
  __device__ void regularize(const Shape& shape, GaussianGradient<float>& gradient) const {
    const RegularizerGradient<float> added =
        regularizer_vjp(shape.log_scale, shape.logit_opacity, of_each);
    gradient.log_scale += added.log_scale;
    gradient.logit_opacity += added.logit_opacity;
  }
};

/// This lane's share of one quantity of a warp's rows, which have kInRow numbers each.
template <int kInRow, class Numbers>
struct Share {
  float loaded[kInRow][Numbers::kArrays];

  __device__ Share(const Numbers& numbers, std::size_t first, int rows) {
    for (int k = 0; k < kInRow; ++k) {
      const int item = lane_of_thread() + k * kWarp;
      for (int a = 0; a < Numbers::kArrays; ++a)
        if (item < rows * kInRow) loaded[k][a] = numbers.arrays[a][first * kInRow + item];
    }
  }
  /// Writes the parameters to `to`, row after row.
  __device__ void lay_out(int rows, float* to) const {
    for (int k = 0; k < kInRow; ++k) {
      const int item = lane_of_thread() + k * kWarp;
      if (item < rows * kInRow) to[item] = loaded[k][0];
    }
  }
  __device__ void finish(const Numbers& numbers, std::size_t first, int rows,
                         const float* gradients) {
    for (int k = 0; k < kInRow; ++k) {
      const int item = lane_of_thread() + k * kWarp;
      if (item < rows * kInRow) numbers.finish(first * kInRow + item, loaded[k], gradients[item]);
    }
  }
};

/// This lane's shares of all quantities without SH.
template <class Sink>
struct Shares {
  using Numbers = typename Sink::Numbers;
  Share<3, Numbers> mean, log_scale, sh0;
  Share<4, Numbers> rotation;
  Share<1, Numbers> logit_opacity;

  __device__ Shares(const Sink& sink, std::size_t first, int rows)
      : mean(sink.mean, first, rows), log_scale(sink.log_scale, first, rows),
        sh0(sink.sh0, first, rows), rotation(sink.rotation, first, rows),
        logit_opacity(sink.logit_opacity, first, rows) {}
  /// The whole warp: returns this lane's row of parameters; the lanes exchange them through shared
  /// memory.
  __device__ Shape row(RowNumbers& shared, int rows) const {
    mean.lay_out(rows, shared.mean);
    log_scale.lay_out(rows, shared.log_scale);
    rotation.lay_out(rows, shared.rotation);
    logit_opacity.lay_out(rows, shared.logit_opacity);
    __syncwarp();
    const int lane = lane_of_thread();
    const auto vector = [&](const float* of) {
      return Vec3f(of[3 * lane], of[3 * lane + 1], of[3 * lane + 2]);
    };
    const float* const q = shared.rotation + 4 * lane;
    const Shape shape{vector(shared.mean),
                      vector(shared.log_scale),
                      {q[0], q[1], q[2], q[3]},
                      shared.logit_opacity[lane]};
    __syncwarp();
    return shape;
  }
  __device__ void finish(const Sink& sink, std::size_t first, int rows,
                         const RowNumbers& gradients) {
    mean.finish(sink.mean, first, rows, gradients.mean);
    log_scale.finish(sink.log_scale, first, rows, gradients.log_scale);
    sh0.finish(sink.sh0, first, rows, gradients.sh0);
    rotation.finish(sink.rotation, first, rows, gradients.rotation);
    logit_opacity.finish(sink.logit_opacity, first, rows, gradients.logit_opacity);
  }
};

/// Writes this lane's row of gradients to shared memory.
__device__ inline void stage(RowNumbers& to, const GaussianGradient<float>& gradient) {
  const int lane = lane_of_thread();
  for (int c = 0; c < 3; ++c) {
    to.mean[3 * lane + c] = gradient.mean[c];
    to.log_scale[3 * lane + c] = gradient.log_scale[c];
    to.sh0[3 * lane + c] = gradient.sh0[c];
  }
  to.rotation[4 * lane] = gradient.rotation.w;
  to.rotation[4 * lane + 1] = gradient.rotation.x;
  to.rotation[4 * lane + 2] = gradient.rotation.y;
  to.rotation[4 * lane + 3] = gradient.rotation.z;
  to.logit_opacity[lane] = gradient.logit_opacity;
}

/// An array as plain numbers.
template <class T>
float* numbers_of(const Span<T>& rows) {
  return reinterpret_cast<float*>(rows.data);
}

}  // namespace gs::cuda
