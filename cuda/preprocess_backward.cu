// SPDX-License-Identifier: Apache-2.0
// Stages 7 and 8: from dL/d(splat) to the stored parameters, and in training straight on to their update, so that no
// gradient of a parameter is ever stored. A thread has one Gaussian; the SH rows of a warp's 32 Gaussians, three
// quarters of all numbers, are read and updated by all its lanes together, number after number.
// Faster-GS, backward fused with Adam
#include <algorithm>

#include "cuda/sh_rows.cuh"
#include "cuda/stages.cuh"
#include "gs_core/math/density.h"
#include "gs_core/math/splat.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 128;  // four warps, each with its own room
constexpr int kBasisStride = kShBasisCount + 1;  // odd: lanes that read one row each hit different banks

// The SH numbers that a lane loads before it updates the first: 15 loads in flight hide the memory's latency.
template <int degree>
inline constexpr int kLoadsAhead = degree == 3 ? 5 : degree == 2 ? 6 : 3;

struct WarpRoom {
  float sh_rows[kWarp * kShRowNumbers];  // as they were before the update
  float basis[kWarp * kBasisStride];     // of the viewing direction of each Gaussian
  float dL_dcolor[kWarp * 3];            // zero where a Gaussian is not visible
};

// Where gradients go, first way: into arrays.
struct WriteGradients {
  GaussiansSpan gradients;
  Vec2f* dL_dmean2d;

  struct ShNumber {
    float value;
  };
  __device__ bool is_halted() const { return false; }
  __device__ ShNumber load_sh(const ShRest* rows, std::size_t number) const {
    return {reinterpret_cast<const float*>(rows)[number]};
  }
  __device__ void finish_sh(std::size_t number, const ShNumber&, float gradient) const {
    reinterpret_cast<float*>(gradients.sh_rest.data)[number] = gradient;
  }
  __device__ void finish_row(std::size_t i, const GaussianGradient<float>& gradient,
                             const Vec2f& by_mean2d, bool) const {
    gradients.mean[i] = gradient.mean;
    gradients.log_scale[i] = gradient.log_scale;
    gradients.rotation[i] = gradient.rotation;
    gradients.logit_opacity[i] = gradient.logit_opacity;
    gradients.sh0[i] = gradient.sh0;
    dL_dmean2d[i] = by_mean2d;
  }
};

// Second way: into the parameters, by Adam; and into the statistics of density control.
struct UpdateByAdam {
  GaussiansSpan rows, m, v;
  AdamSteps steps;
  float* visits;         // null: no statistics
  float* gradient_norm;
  int width, height;
  const std::uint32_t* halted;

  struct ShNumber {
    float value, m, v;
  };
  __device__ bool is_halted() const { return *halted != 0; }
  __device__ ShNumber load_sh(const ShRest*, std::size_t number) const {
    return {reinterpret_cast<const float*>(rows.sh_rest.data)[number],
            reinterpret_cast<const float*>(m.sh_rest.data)[number],
            reinterpret_cast<const float*>(v.sh_rest.data)[number]};
  }
  __device__ void finish_sh(std::size_t number, ShNumber sh, float gradient) const {
    adam_update(sh.value, sh.m, sh.v, gradient, steps.sh_rest);
    reinterpret_cast<float*>(rows.sh_rest.data)[number] = sh.value;
    reinterpret_cast<float*>(m.sh_rest.data)[number] = sh.m;
    reinterpret_cast<float*>(v.sh_rest.data)[number] = sh.v;
  }
  __device__ void finish_row(std::size_t i, const GaussianGradient<float>& gradient,
                             const Vec2f& by_mean2d, bool is_visible) const {
    // All loads before the first store, so that they wait for the memory together.
    Vector<Vec3f> mean(rows.mean, m.mean, v.mean, i);
    Vector<Vec3f> log_scale(rows.log_scale, m.log_scale, v.log_scale, i);
    Vector<Quatf> rotation(rows.rotation, m.rotation, v.rotation, i);
    Vector<float> logit_opacity(rows.logit_opacity, m.logit_opacity, v.logit_opacity, i);
    Vector<Vec3f> sh0(rows.sh0, m.sh0, v.sh0, i);
    mean.update(gradient.mean, steps.mean, rows.mean, m.mean, v.mean, i);
    log_scale.update(gradient.log_scale, steps.log_scale, rows.log_scale, m.log_scale, v.log_scale, i);
    rotation.update(gradient.rotation, steps.rotation, rows.rotation, m.rotation, v.rotation, i);
    logit_opacity.update(gradient.logit_opacity, steps.logit_opacity, rows.logit_opacity,
                         m.logit_opacity, v.logit_opacity, i);
    sh0.update(gradient.sh0, steps.sh0, rows.sh0, m.sh0, v.sh0, i);
    if (visits && is_visible) {
      visits[i] += 1.0f;
      gradient_norm[i] += screen_gradient_norm(by_mean2d, width, height);
    }
  }

 private:
  // One quantity of a row with its moments.
  template <class T>
  struct Vector {
    T p, m, v;
    __device__ Vector(const Span<T>& from_p, const Span<T>& from_m, const Span<T>& from_v,
                      std::size_t i)
        : p(from_p[i]), m(from_m[i]), v(from_v[i]) {}
    __device__ void update(const T& gradient, const AdamStep& step, const Span<T>& to_p,
                           const Span<T>& to_m, const Span<T>& to_v, std::size_t i) {
      constexpr int kNumbers = sizeof(T) / sizeof(float);
      for (int k = 0; k < kNumbers; ++k)
        adam_update(reinterpret_cast<float*>(&p)[k], reinterpret_cast<float*>(&m)[k],
                    reinterpret_cast<float*>(&v)[k], reinterpret_cast<const float*>(&gradient)[k],
                    step);
      to_p[i] = p;
      to_m[i] = m;
      to_v[i] = v;
    }
  };
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

// The whole warp: the gradients of `rows` SH rows from row `first` on, and what becomes of them.
template <int degree, class Sink>
__device__ void finish_sh_rows(WarpRoom& room, const ShRest* sh_rest, std::size_t first, int rows,
                               const Sink& sink) {
  constexpr int kNumbers = std::max(kShNumbersInUse<degree>, 1), kAhead = kLoadsAhead<degree>;
  const int lane = lane_of_thread(), total = rows * kNumbers;
  for (int begin = lane; begin < total; begin += kWarp * kAhead) {
    typename Sink::ShNumber loaded[kAhead];
#pragma unroll
    for (int k = 0; k < kAhead; ++k) {
      const int item = begin + k * kWarp, row = item / kNumbers, number = item % kNumbers;
      if (item < total) loaded[k] = sink.load_sh(sh_rest, (first + row) * kShRowNumbers + number);
    }
#pragma unroll
    for (int k = 0; k < kAhead; ++k) {
      const int item = begin + k * kWarp, row = item / kNumbers, number = item % kNumbers;
      if (item >= total) continue;
      room.sh_rows[row * kShRowNumbers + number] = loaded[k].value;
      const float gradient =
          room.basis[row * kBasisStride + 1 + number / 3] * room.dL_dcolor[row * 3 + number % 3];
      sink.finish_sh((first + row) * kShRowNumbers + number, loaded[k], gradient);
    }
  }
}

// The whole warp: through colour to the SH coefficients; returns dL/d(mean) by way of the viewing direction.
template <int degree, class Sink>
__device__ Vec3f color_backward(WarpRoom& room, const GaussiansSpan& rows, const Camera& camera,
                                std::size_t i, bool is_visible, const Vec3f& dL_dcolor,
                                const Sink& sink) {
  if constexpr (degree == 0) return Vec3f(0.0f);
  const int lane = lane_of_thread();
  const std::size_t first = i - lane;
  float* const basis = room.basis + lane * kBasisStride;
  Vec3f direction(0.0f);
  if (is_visible) {
    direction = unit_direction(camera.position(), rows.mean[i]);
    sh_basis(degree, direction, basis);
  } else {
    for (int k = 0; k < kShBasisCount; ++k) basis[k] = 0.0f;
  }
  for (int c = 0; c < 3; ++c) room.dL_dcolor[3 * lane + c] = dL_dcolor[c];
  __syncwarp();
  const std::size_t left = rows.mean.size - min(first, rows.mean.size);
  finish_sh_rows<degree>(room, rows.sh_rest.data, first, int(min(left, std::size_t(kWarp))), sink);
  __syncwarp();
  if (!is_visible) return Vec3f(0.0f);
  const Vec3f* const row = reinterpret_cast<const Vec3f*>(room.sh_rows + lane * kShRowNumbers);
  float dL_dbasis[kShBasisCount];
  for (int k = 1; k < (degree + 1) * (degree + 1); ++k)
    dL_dbasis[k] = inner(row[k - 1], dL_dcolor);
  return unit_direction_vjp(camera.position(), rows.mean[i],
                            sh_basis_vjp(degree, direction, dL_dbasis));
}

template <int degree, class Sink>
__global__ void __launch_bounds__(kThreads)
    preprocess_backward_kernel(GaussiansSpan rows, Camera camera, SplatSettings settings,
                               const std::uint32_t* tile_counts, const Splat* splats,
                               SplatGradientSum* sums, Sink sink) {
  __shared__ WarpRoom rooms[kThreads / kWarp];
  WarpRoom& room = rooms[threadIdx.x / kWarp];
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  const bool is_visible = i < rows.mean.size && tile_counts[i] > 0;
  SplatGradient dL_dsplat{};
  if (is_visible) dL_dsplat = take_sum(sums[i], splats[i].color);
  if (sink.is_halted()) return;

  const Vec3f by_direction = color_backward<degree>(room, rows, camera, i, is_visible,
                                                    dL_dsplat.color, sink);
  if (i >= rows.mean.size) return;
  GaussianGradient<float> gradient{};
  if (is_visible) {
    gradient = project_shape_vjp(camera, rows.mean[i], rows.log_scale[i], rows.rotation[i],
                                 rows.logit_opacity[i], settings, dL_dsplat);
    gradient.mean += by_direction;
    gradient.sh0 = float(kSh0) * dL_dsplat.color;
  }
  sink.finish_row(i, gradient, dL_dsplat.mean2d, is_visible);
}

template <class Sink>
void launch(Context& context, const GaussiansSpan& rows, const Camera& camera,
            const RenderSettings& settings, WorkingRoom& room, RenderPass& pass, const Sink& sink) {
  with_sh_degree(settings.sh_degree, [&](auto degree) {
    context.launch("preprocess backward", preprocess_backward_kernel<degree(), Sink>,
                   blocks_for(rows.mean.size, kThreads), kThreads, rows, camera, settings,
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
  launch(context, gaussians, camera, settings, room, pass,
         WriteGradients{gradients, dL_dmean2d.data});
}

void preprocess_backward_and_update(Context& context, TrainingModel& model, const Camera& camera,
                                    const RenderSettings& settings, const AdamSteps& steps,
                                    bool gather_statistics, WorkingRoom& room, RenderPass& pass) {
  const StageScope scope(context, "preprocess backward, Adam");
  const DensityStatistics& statistics = model.statistics;
  const UpdateByAdam sink{model.gaussians.span(),
                          model.first_moment.span(),
                          model.second_moment.span(),
                          steps,
                          gather_statistics ? statistics.visits.data() : nullptr,
                          statistics.gradient_norm.data(),
                          pass.width,
                          pass.height,
                          room.halted.data()};
  launch(context, model.gaussians.span(), camera, settings, room, pass, sink);
}

}  // namespace gs::cuda
