// SPDX-License-Identifier: Apache-2.0
// Stages 7 and 8: from dL/d(splat) to the stored parameters, and in training straight on to their update, so that no
// gradient of a parameter is ever stored. A thread pulls the gradient of one Gaussian back; what becomes of the
// gradients is done by the whole warp, number after number of its 32 rows, so that it reads and writes whole cache
// lines.   Faster-GS, backward fused with Adam
#include <algorithm>

#include "cuda/sh_rows.cuh"
#include "cuda/stages.cuh"
#include "gs_core/math/density.h"
#include "gs_core/math/splat.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 128;  // four warps, each with its own room
constexpr int kBlocks = 6;     // of a multiprocessor: as many as its shared memory holds
constexpr int kBasisStride = kShBasisCount + 1;  // odd: lanes that read one row each hit different banks

// Loads of a lane before it uses the first, so that they wait for the memory together.
constexpr int kVectorsAhead = 3;
constexpr int kNumbersAhead = 6;

// The gradients of a warp's rows, but for SH: each quantity row after row, as it lies in its array.
struct RowGradients {
  float mean[3 * kWarp], log_scale[3 * kWarp], rotation[4 * kWarp], logit_opacity[kWarp], sh0[3 * kWarp];
};

struct alignas(16) WarpRoom {
  float sh_rows[kWarp * kShRowNumbers];  // as they were before the update
  union {
    float basis[kWarp * kBasisStride];   // of the viewing direction of each Gaussian
    RowGradients gradients;              // thereafter
  };
  float dL_dcolor[kWarp * 3];            // zero where a Gaussian is not visible
};

// The numbers of one quantity and what a gradient does to them, first way: it is written to an array.
struct GradientNumbers {
  const float* values;
  float* gradients;

  template <class Vector>
  struct Loaded {
    Vector value;
  };
  template <class Vector>
  __device__ Loaded<Vector> load(std::size_t at) const {
    return {reinterpret_cast<const Vector*>(values)[at]};
  }
  template <class Vector>
  __device__ void finish(std::size_t at, const Loaded<Vector>&, const Vector& gradient) const {
    reinterpret_cast<Vector*>(gradients)[at] = gradient;
  }
};

// Second way: Adam moves the parameter. Vector is float or float4.
struct AdamNumbers {
  float *values, *m, *v;
  AdamStep step;

  template <class Vector>
  struct Loaded {
    Vector value, m, v;
  };
  template <class Vector>
  __device__ Loaded<Vector> load(std::size_t at) const {
    return {reinterpret_cast<const Vector*>(values)[at], reinterpret_cast<const Vector*>(m)[at],
            reinterpret_cast<const Vector*>(v)[at]};
  }
  template <class Vector>
  __device__ void finish(std::size_t at, Loaded<Vector> loaded, const Vector& gradient) const {
    for (int k = 0; k < int(sizeof(Vector) / sizeof(float)); ++k)
      adam_update(reinterpret_cast<float*>(&loaded.value)[k], reinterpret_cast<float*>(&loaded.m)[k],
                  reinterpret_cast<float*>(&loaded.v)[k],
                  reinterpret_cast<const float*>(&gradient)[k], step);
    reinterpret_cast<Vector*>(values)[at] = loaded.value;
    reinterpret_cast<Vector*>(m)[at] = loaded.m;
    reinterpret_cast<Vector*>(v)[at] = loaded.v;
  }
};

// All quantities, and what else a row's gradient is good for.
struct WriteGradients {
  using Numbers = GradientNumbers;
  Numbers mean, log_scale, rotation, logit_opacity, sh0, sh_rest;
  Vec2f* dL_dmean2d;

  __device__ bool is_halted() const { return false; }
  __device__ void note(std::size_t i, const Vec2f& by_mean2d, bool) const {
    dL_dmean2d[i] = by_mean2d;
  }
};
struct UpdateByAdam {
  using Numbers = AdamNumbers;
  Numbers mean, log_scale, rotation, logit_opacity, sh0, sh_rest;
  float* visits;         // null: no statistics
  float* gradient_norm;
  int width, height;
  const std::uint32_t* halted;

  __device__ bool is_halted() const { return *halted != 0; }
  __device__ void note(std::size_t i, const Vec2f& by_mean2d, bool is_visible) const {
    if (!visits || !is_visible) return;
    visits[i] += 1.0f;
    gradient_norm[i] += screen_gradient_norm(by_mean2d, width, height);
  }
};

// dL/d(splat) of a visible Gaussian, with colours masked where blending clamped them; clears the sum.
__device__ SplatGradient take_sum(SplatGradientSum& sum, const Vec3f& color) {
  const SplatGradientSum total = load_in_vectors(&sum);
  store_in_vectors(&sum, SplatGradientSum{});
  return {total.mean2d,
          {total.conic_xx, total.conic_xy, total.conic_yy},
          total.opacity,
          {color.x >= 0.0f ? total.red : 0.0f, color.y >= 0.0f ? total.green : 0.0f,
           color.z >= 0.0f ? total.blue : 0.0f}};
}

// dL/d(number `number` of SH row `row` of the warp).
__device__ float sh_gradient(const WarpRoom& room, int row, int number) {
  return room.basis[row * kBasisStride + 1 + number / 3] * room.dL_dcolor[row * 3 + number % 3];
}

// The whole warp: the numbers in use of its SH rows, one at a time.
template <int degree, class Numbers>
__device__ void finish_sh_numbers(WarpRoom& room, const Numbers& numbers, std::size_t first, int rows) {
  constexpr int kInUse = std::max(kShNumbersInUse<degree>, 1);
  const int total = rows * kInUse;
  for (int begin = lane_of_thread(); begin < total; begin += kWarp * kNumbersAhead) {
    typename Numbers::template Loaded<float> loaded[kNumbersAhead];
#pragma unroll
    for (int k = 0; k < kNumbersAhead; ++k) {
      const int item = begin + k * kWarp, row = item / kInUse, number = item % kInUse;
      if (item < total)
        loaded[k] = numbers.template load<float>((first + row) * kShRowNumbers + number);
    }
#pragma unroll
    for (int k = 0; k < kNumbersAhead; ++k) {
      const int item = begin + k * kWarp, row = item / kInUse, number = item % kInUse;
      if (item >= total) continue;
      room.sh_rows[row * kShRowNumbers + number] = loaded[k].value;
      numbers.finish((first + row) * kShRowNumbers + number, loaded[k],
                     sh_gradient(room, row, number));
    }
  }
}

// The same for 32 whole rows, four numbers at a time.
template <class Numbers>
__device__ void finish_sh_vectors(WarpRoom& room, const Numbers& numbers, std::size_t first) {
  constexpr int kVectors = kWarp * kShRowNumbers / 4;
  const std::size_t base = first / 4 * kShRowNumbers;  // `first` is a multiple of 32
  for (int begin = lane_of_thread(); begin < kVectors; begin += kWarp * kVectorsAhead) {
    typename Numbers::template Loaded<float4> loaded[kVectorsAhead];
#pragma unroll
    for (int k = 0; k < kVectorsAhead; ++k)
      if (begin + k * kWarp < kVectors)
        loaded[k] = numbers.template load<float4>(base + begin + k * kWarp);
#pragma unroll
    for (int k = 0; k < kVectorsAhead; ++k) {
      const int item = begin + k * kWarp;
      if (item >= kVectors) continue;
      reinterpret_cast<float4*>(room.sh_rows)[item] = loaded[k].value;
      const int row = 4 * item / kShRowNumbers, number = 4 * item % kShRowNumbers;
      float gradient[4];
      for (int j = 0; j < 4; ++j) {
        const bool is_next = number + j >= kShRowNumbers;
        gradient[j] = sh_gradient(room, row + is_next, number + j - (is_next ? kShRowNumbers : 0));
      }
      numbers.finish(base + item, loaded[k],
                     float4{gradient[0], gradient[1], gradient[2], gradient[3]});
    }
  }
}

// The whole warp: through colour to the SH coefficients of its `rows` rows; returns dL/d(mean) by way of the viewing
// direction.
template <int degree, class Numbers>
__device__ Vec3f color_backward(WarpRoom& room, const Vec3f* means, const Camera& camera,
                                std::size_t i, int rows, bool is_visible, const Vec3f& dL_dcolor,
                                const Numbers& numbers) {
  if constexpr (degree == 0) return Vec3f(0.0f);
  const int lane = lane_of_thread();
  const std::size_t first = i - lane;
  float* const basis = room.basis + lane * kBasisStride;
  Vec3f direction(0.0f);
  if (is_visible) {
    direction = unit_direction(camera.position(), means[i]);
    sh_basis(degree, direction, basis);
  } else {
    for (int k = 0; k < kShBasisCount; ++k) basis[k] = 0.0f;
  }
  for (int c = 0; c < 3; ++c) room.dL_dcolor[3 * lane + c] = dL_dcolor[c];
  __syncwarp();
  if (degree == kMaxShDegree && rows == kWarp)
    finish_sh_vectors(room, numbers, first);
  else
    finish_sh_numbers<degree>(room, numbers, first, rows);
  __syncwarp();
  if (!is_visible) return Vec3f(0.0f);
  const Vec3f* const row = reinterpret_cast<const Vec3f*>(room.sh_rows + lane * kShRowNumbers);
  float dL_dbasis[kShBasisCount];
  for (int k = 1; k < (degree + 1) * (degree + 1); ++k)
    dL_dbasis[k] = inner(row[k - 1], dL_dcolor);
  return unit_direction_vjp(camera.position(), means[i], sh_basis_vjp(degree, direction, dL_dbasis));
}

// A quantity with kInRow numbers a row: this lane's share of the numbers of a warp's rows.
template <int kInRow, class Numbers>
struct Share {
  typename Numbers::template Loaded<float> loaded[kInRow];

  __device__ Share(const Numbers& numbers, std::size_t first, int rows) {
#pragma unroll
    for (int k = 0; k < kInRow; ++k) {
      const int item = lane_of_thread() + k * kWarp;
      if (item < rows * kInRow) loaded[k] = numbers.template load<float>(first * kInRow + item);
    }
  }
  __device__ void finish(const Numbers& numbers, std::size_t first, int rows,
                         const float* gradients) const {
#pragma unroll
    for (int k = 0; k < kInRow; ++k) {
      const int item = lane_of_thread() + k * kWarp;
      if (item < rows * kInRow) numbers.finish(first * kInRow + item, loaded[k], gradients[item]);
    }
  }
};

// The whole warp: all quantities but SH, with the gradients in its room.
template <class Sink>
__device__ void finish_rows(const RowGradients& gradients, const Sink& sink, std::size_t first, int rows) {
  using Numbers = typename Sink::Numbers;
  const Share<3, Numbers> mean(sink.mean, first, rows), log_scale(sink.log_scale, first, rows),
      sh0(sink.sh0, first, rows);
  const Share<4, Numbers> rotation(sink.rotation, first, rows);
  const Share<1, Numbers> logit_opacity(sink.logit_opacity, first, rows);
  mean.finish(sink.mean, first, rows, gradients.mean);
  log_scale.finish(sink.log_scale, first, rows, gradients.log_scale);
  sh0.finish(sink.sh0, first, rows, gradients.sh0);
  rotation.finish(sink.rotation, first, rows, gradients.rotation);
  logit_opacity.finish(sink.logit_opacity, first, rows, gradients.logit_opacity);
}

__device__ void stage(RowGradients& to, const GaussianGradient<float>& gradient) {
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

template <int degree, class Sink>
__global__ void __launch_bounds__(kThreads, kBlocks)
    preprocess_backward_kernel(GaussiansSpan gaussians, Camera camera, SplatSettings settings,
                               const std::uint32_t* tile_counts, const Splat* splats,
                               SplatGradientSum* sums, Sink sink) {
  __shared__ WarpRoom rooms[kThreads / kWarp];
  WarpRoom& room = rooms[threadIdx.x / kWarp];
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  const std::size_t count = gaussians.mean.size, first = i - lane_of_thread();
  if (first >= count) return;  // the whole warp
  const int rows = int(min(count - first, std::size_t(kWarp)));
  const bool is_visible = i < count && tile_counts[i] > 0;
  SplatGradient dL_dsplat{};
  if (is_visible) dL_dsplat = take_sum(sums[i], splats[i].color);
  if (sink.is_halted()) return;

  GaussianGradient<float> gradient{};
  const Vec3f by_direction = color_backward<degree>(room, gaussians.mean.data, camera, i, rows,
                                                    is_visible, dL_dsplat.color, sink.sh_rest);
  if (is_visible) {
    gradient = project_shape_vjp(camera, gaussians.mean[i], gaussians.log_scale[i],
                                 gaussians.rotation[i], gaussians.logit_opacity[i], settings,
                                 dL_dsplat);
    gradient.mean += by_direction;
    gradient.sh0 = float(kSh0) * dL_dsplat.color;
  }
  if (i < count) sink.note(i, dL_dsplat.mean2d, is_visible);
  stage(room.gradients, gradient);
  __syncwarp();
  finish_rows(room.gradients, sink, first, rows);
}

template <class T>
float* numbers_of(const Span<T>& rows) {
  return reinterpret_cast<float*>(rows.data);
}

template <class Sink>
void launch(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
            const RenderSettings& settings, WorkingRoom& room, RenderPass& pass, const Sink& sink) {
  with_sh_degree(settings.sh_degree, [&](auto degree) {
    context.launch("preprocess backward", preprocess_backward_kernel<degree(), Sink>,
                   blocks_for(gaussians.mean.size, kThreads), kThreads, gaussians, camera, settings,
                   pass.tile_counts.data(), pass.splats.data(), room.splat_gradients.data(), sink);
  });
}

}  // namespace

void preprocess_backward(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                         const RenderSettings& settings, WorkingRoom& room, RenderPass& pass,
                         const GaussiansSpan& gradients, Span<Vec2f> dL_dmean2d) {
  const StageScope scope(context, "preprocess backward");
  if (settings.sh_degree < kMaxShDegree && gradients.sh_rest.size)  // degrees not in use have none
    check(cudaMemsetAsync(gradients.sh_rest.data, 0, gradients.sh_rest.size * sizeof(ShRest),
                          context.stream()),
          "preprocess backward");
  const auto numbers = [](const auto& rows, const auto& to) {
    return GradientNumbers{numbers_of(rows), numbers_of(to)};
  };
  const WriteGradients sink{numbers(gaussians.mean, gradients.mean),
                            numbers(gaussians.log_scale, gradients.log_scale),
                            numbers(gaussians.rotation, gradients.rotation),
                            numbers(gaussians.logit_opacity, gradients.logit_opacity),
                            numbers(gaussians.sh0, gradients.sh0),
                            numbers(gaussians.sh_rest, gradients.sh_rest),
                            dL_dmean2d.data};
  launch(context, gaussians, camera, settings, room, pass, sink);
}

void preprocess_backward_and_update(Context& context, TrainingModel& model, const Camera& camera,
                                    const RenderSettings& settings, const AdamSteps& steps,
                                    bool gather_statistics, WorkingRoom& room, RenderPass& pass) {
  const StageScope scope(context, "preprocess backward, Adam");
  const GaussiansSpan rows = model.gaussians.span(), m = model.first_moment.span(),
                      v = model.second_moment.span();
  const auto numbers = [](const auto& rows, const auto& m, const auto& v, const AdamStep& step) {
    return AdamNumbers{numbers_of(rows), numbers_of(m), numbers_of(v), step};
  };
  const UpdateByAdam sink{
      numbers(rows.mean, m.mean, v.mean, steps.mean),
      numbers(rows.log_scale, m.log_scale, v.log_scale, steps.log_scale),
      numbers(rows.rotation, m.rotation, v.rotation, steps.rotation),
      numbers(rows.logit_opacity, m.logit_opacity, v.logit_opacity, steps.logit_opacity),
      numbers(rows.sh0, m.sh0, v.sh0, steps.sh0),
      numbers(rows.sh_rest, m.sh_rest, v.sh_rest, steps.sh_rest),
      gather_statistics ? model.statistics.visits.data() : nullptr,
      model.statistics.gradient_norm.data(),
      pass.width,
      pass.height,
      room.halted.data()};
  launch(context, rows, camera, settings, room, pass, sink);
}

}  // namespace gs::cuda
