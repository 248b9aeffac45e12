// SPDX-License-Identifier: Apache-2.0
// Stages 7 and 8: from dL/d(splat) to the gradients of the parameters. In training the update
// follows at once, so that no gradient of a parameter is stored. A thread pulls the gradient of one
// Gaussian back. The whole warp then writes the gradients or updates the parameters, one number of
// its 32 rows after another, in whole cache lines. All loads are issued at the start, so that the
// warp waits for memory only once.   Faster-GS, backward fused with Adam
#pragma once

#include <algorithm>

#include "cuda/render/sh_rows.cuh"
#include "cuda/stages.cuh"
#include "cuda/train/row_updates.cuh"
#include "cuda/train/updates_of_codes.cuh"
#include "gs_core/math/filtered_splat.h"
#include "gs_core/math/spacetime_splat.h"

namespace gs::cuda {

// One warp: shared memory, which bounds the number of warps on a multiprocessor, is given to blocks.
inline constexpr int kGradientThreads = kWarp;
inline constexpr int kBasisStride =
    kShBasisCount + 1;  // odd, so that 32 rows begin in different banks

template <class Numbers>
struct GradientShared : CodeRows<Numbers::kHasCodes> {
  // of the parameters, and what goes along; aligned for copies of 16 bytes
  alignas(16) float sh_rows[kFloatArrays<Numbers>][kWarp * kShRowNumbers];
  union {
    RowNumbers numbers;                   // parameters at first, gradients in the end
    struct {                              // between
      float basis[kWarp * kBasisStride];  // of the viewing direction of each Gaussian
      float dL_dcolor[kWarp * 3];         // zero where a Gaussian is not visible
    };
  };
};

// dL/d(number `number` of SH row `row` of the warp).
template <class Shared>
__device__ float sh_gradient(const Shared& shared, int row, int number) {
  return shared.basis[row * kBasisStride + 1 + number / 3] * shared.dL_dcolor[row * 3 + number % 3];
}

// The whole warp: starts to copy its SH rows into shared memory, so that they arrive during other
// work.
template <int degree, class Shared, class Numbers, class Which>
__device__ void start_sh_rows(Shared& shared, const Numbers& numbers, std::size_t first, int rows,
                              Which which) {
  for (int a = 0; a < kFloatArrays<Numbers>; ++a)
    start_sh_copy<degree>(shared.sh_rows[a], numbers.arrays[a] + first * kShRowNumbers, rows,
                          which);
  if constexpr (degree > 0 && Numbers::kHasCodes)
    start_copy_of_codes<degree>(
        shared.sh_codes,
        reinterpret_cast<const std::uint16_t*>(numbers.arrays[1]) + first * kShRowNumbers, rows,
        which);
  __pipeline_commit();
}

// The whole warp: applies the gradients to its SH rows, one number at a time.
template <int degree, class Shared, class Numbers, class Which>
__device__ void finish_sh_numbers(Shared& shared, const Numbers& numbers, std::size_t first,
                                  int rows, Which which) {
  constexpr int kInUse = std::max(kShNumbersInUse<degree>, 1);
  for (int item = lane_of_thread(); item < rows * kInUse; item += kWarp) {
    const int row = item / kInUse, number = item % kInUse, at = row * kShRowNumbers + number;
    if (!which.has(row)) continue;
    float loaded[Numbers::kArrays];
    load_sh(shared, numbers, at, loaded);
    numbers.finish(first * kShRowNumbers + at, loaded, sh_gradient(shared, row, number),
                   NumberPlace<Shared>{shared, row, number, kShRowNumbers});
  }
}

// The same for 32 whole rows, four numbers at a time.
template <class Shared, class Numbers, class Which>
__device__ void finish_sh_vectors(Shared& shared, const Numbers& numbers, std::size_t first,
                                  Which which) {
  const std::size_t base = first / 4 * kShRowNumbers;  // `first` is a multiple of 32
  for (int item = lane_of_thread(); item < kWarp * kShRowNumbers / 4; item += kWarp) {
    const int row = 4 * item / kShRowNumbers, number = 4 * item % kShRowNumbers;
    if (!which.has(row) && !which.has((4 * item + 3) / kShRowNumbers)) continue;
    float gradient[4];
    for (int k = 0; k < 4; ++k) {
      const bool is_next = number + k >= kShRowNumbers;
      gradient[k] = sh_gradient(shared, row + is_next, number + k - (is_next ? kShRowNumbers : 0));
    }
    float4 loaded[Numbers::kArrays];
    load_sh(shared, numbers, item, loaded);
    numbers.finish(base + item, loaded, float4{gradient[0], gradient[1], gradient[2], gradient[3]},
                   NumberPlace<Shared>{shared, row, number, kShRowNumbers});
  }
}

// The whole warp: pulls the color gradients back to the SH coefficients of its `rows` rows. Returns
// the part of dL/d(mean) that comes from the viewing direction.
template <int degree, class Shared, class Numbers, class Which>
__device__ Vec3f color_backward(Shared& shared, const Vec3f& mean, const Camera& camera,
                                std::size_t first, int rows, bool is_visible,
                                const Vec3f& dL_dcolor, const Numbers& numbers, Which which) {
  if constexpr (degree == 0) return Vec3f(0.0f);
  const int lane = lane_of_thread();
  float* const basis = shared.basis + lane * kBasisStride;
  Vec3f direction(0.0f);
  if (is_visible) {
    direction = unit_direction(camera.position(), mean);
    sh_basis(degree, direction, basis);
  } else {
    for (int k = 0; k < kShBasisCount; ++k) basis[k] = 0.0f;
  }
  for (int c = 0; c < 3; ++c) shared.dL_dcolor[3 * lane + c] = dL_dcolor[c];
  __pipeline_wait_prior(0);
  __syncwarp();
  if (degree == kMaxShDegree && rows == kWarp)
    finish_sh_vectors(shared, numbers, first, which);
  else
    finish_sh_numbers<degree>(shared, numbers, first, rows, which);
  if (!is_visible) return Vec3f(0.0f);
  const Vec3f* const row = reinterpret_cast<const Vec3f*>(shared.sh_rows[0] + lane * kShRowNumbers);
  float dL_dbasis[kShBasisCount];
  for (int k = 1; k < (degree + 1) * (degree + 1); ++k) dL_dbasis[k] = inner(row[k - 1], dL_dcolor);
  return unit_direction_vjp(camera.position(), mean, sh_basis_vjp(degree, direction, dL_dbasis));
}

// dL/d(parameters) of a visible Gaussian, without the color's part.
__device__ inline RowGradient pull_back(const Camera& camera, const Shape& shape,
                                        float filter_scale, const SplatSettings& settings,
                                        const SplatGradient& dL_dsplat) {
  return {project_shape_vjp(camera, shape.mean, shape.log_scale, shape.rotation,
                            shape.logit_opacity, filter_scale, settings, dL_dsplat)};
}
// The same in space and time. `by_color` is the color's part of dL/d(mean at the moment).
__device__ inline RowGradient pull_back_in_time(const Camera& camera, const Shape& shape,
                                                const SplatSettings& settings,
                                                const SplatGradient& dL_dsplat,
                                                const Vec3f& by_color) {
  RowGradient gradient{};
  gradient.take(
      project_shape_vjp(camera, shape.in_spacetime(), camera.time, settings, dL_dsplat, by_color));
  return gradient;
}

// What one launch works on.
struct Input {
  std::size_t count;  // rows of the shard
  Camera given;
  const DevicePose* pose;  // null: that of the camera
  SplatSettings settings;
  const std::uint32_t* tile_counts;  // (N)
  const Splat* splats;               // (N)
  SplatGradientSum* sums;            // (N)
  Shard shard;                       // the three arrays above have the rows of the whole model
  const float* filter_scale;         // (count)  null without a 3D filter
};

template <class Sink>
using SharedOf = GradientShared<typename Sink::Numbers>;

// The whole warp: those of rows first .. first + 31 that `which` has.
template <int degree, bool has_time, class Sink, class Which>
__device__ void pull_back_rows(SharedOf<Sink>& shared, const Input& in, std::size_t first,
                               Which which, const Sink& sink) {
  const Camera camera = refined(in.given, in.pose);
  const std::size_t i = first + lane_of_thread(), projected = in.shard.row_of_all(i);
  const int rows = int(min(in.count - first, std::size_t(kWarp)));
  // All loads come first, before any store, so that the warp waits for memory only once.
  if (degree > 0) start_sh_rows<degree>(shared, sink.sh_rest, first, rows, which);
  const bool is_halted = sink.is_halted(), is_row = i < in.count && which.has(lane_of_thread());
  Shares<Sink, has_time> shares(sink, first, rows, which);
  const typename Sink::Statistics statistics =
      is_row ? sink.load_statistics(i) : typename Sink::Statistics{};
  const SplatGradientSum sum = is_row ? load_in_vectors(in.sums + projected) : SplatGradientSum{};
  const Splat& splat = in.splats[projected];
  const Vec3f color = is_row ? splat.color : Vec3f(0.0f);  // undefined where not visible
  const float opacity = sink.adds_forces() && is_row ? splat.opacity : 0.0f;
  const bool is_visible = is_row && in.tile_counts[projected] > 0;
  const float filter_scale = in.filter_scale && is_row ? in.filter_scale[i] : 0.0f;
  if (is_visible) store_in_vectors(in.sums + projected, SplatGradientSum{});  // for the next step
  if (is_halted) return;
  if constexpr (Sink::kSkipsInvisible)
    if (lane_of_thread() == 0) sink.touched[first / kWarp] |= which.bits;

  if constexpr (Sink::Numbers::kHasCodes)  // the lanes wait for each other in row()
    shared.random[lane_of_thread()] = sink.mean.rounding.of_row(projected);
  const Shape shape = shares.row(shared.numbers, rows, which);
  SplatGradient dL_dsplat{};
  RowGradient gradient{};
  Vec2f by_mean2d(0.0f);
  if (is_visible) {
    dL_dsplat = masked(sum, color);
    by_mean2d = sink.by_mean2d(sum);
    sink.add_forces(i, sum, opacity);
  }
  if constexpr (has_time) {
    // The color's part of the mean reaches the time, too, so that it comes first.
    const Vec3f mean = is_visible ? mean_at(shape.in_spacetime(), camera.time) : Vec3f(0.0f);
    const Vec3f by_color = color_backward<degree>(shared, mean, camera, first, rows, is_visible,
                                                  dL_dsplat.color, sink.sh_rest, which);
    if (is_visible) gradient = pull_back_in_time(camera, shape, in.settings, dL_dsplat, by_color);
  } else {
    if (is_visible) gradient = pull_back(camera, shape, filter_scale, in.settings, dL_dsplat);
    gradient.mean += color_backward<degree>(shared, shape.mean, camera, first, rows, is_visible,
                                            dL_dsplat.color, sink.sh_rest, which);
  }
  if (is_visible) gradient.sh0 = float(kSh0) * dL_dsplat.color;
  sink.template regularize<has_time>(shape, gradient);
  if (is_row) sink.note(i, statistics, by_mean2d, is_visible);
  __syncwarp();
  stage<has_time>(shared.numbers, gradient);
  __syncwarp();
  shares.finish(sink, first, rows, which, shared.numbers, shared);
}

// A photo of a batch leaves most rows alone, and a block for a few of them takes longer to start
// than to work. Therefore a warp looks at this many groups of 32 rows, far from each other. It
// reads and writes visible rows only.
inline constexpr int kGroupsOfWarp = 8;

// The least blocks of a multiprocessor, a quarter of them on each of its parts. Shared memory has
// room for 11 with moments that are floats and for 18 with codes. Gaussians in space and time need
// more registers than so many blocks would leave.
template <bool has_time, class Numbers>
inline constexpr int kLeastBlocks = Numbers::kHasCodes ? (has_time ? 12 : 16) : (has_time ? 8 : 11);

template <int degree, bool has_time, class Sink>
__global__ void __launch_bounds__(
    kGradientThreads, Sink::kSkipsInvisible ? 10 : kLeastBlocks<has_time, typename Sink::Numbers>)
    preprocess_backward_kernel(const Input in, const Sink sink) {
  __shared__ SharedOf<Sink> shared_of_warps[kGradientThreads / kWarp];
  auto& shared = shared_of_warps[threadIdx.x / kWarp];
  const std::size_t i = std::size_t(blockIdx.x) * kGradientThreads + threadIdx.x;
  const std::size_t first = i - lane_of_thread();
  if constexpr (Sink::kSkipsInvisible) {
    const std::size_t stride = std::size_t(gridDim.x) * kGradientThreads;
    const auto is_visible = [&](int group) {
      const std::size_t row = i + group * stride;
      return row < in.count && in.tile_counts[in.shard.row_of_all(row)] > 0;
    };
    bool visible[kGroupsOfWarp];
    for (int k = 0; k < kGroupsOfWarp; ++k) visible[k] = is_visible(k);
    std::uint32_t groups = 0;
    for (int k = 0; k < kGroupsOfWarp; ++k)
      if (__any_sync(kAllLanes, visible[k])) groups |= 1u << k;
#pragma unroll 1
    for (; groups; groups &= groups - 1) {
      const int group = __ffs(int(groups)) - 1;
      const SomeRows rows{__ballot_sync(kAllLanes, is_visible(group))};
      pull_back_rows<degree, has_time>(shared, in, first + group * stride, rows, sink);
      __syncwarp();
    }
  } else {
    if (first < in.count) pull_back_rows<degree, has_time>(shared, in, first, EveryRow(), sink);
  }
}

template <class Sink>
void launch(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
            const RenderSettings& settings, Workspace& workspace, RenderPass& pass,
            const Sink& sink, const DevicePose* pose = nullptr, const Shard& shard = {}) {
  const Input in{gaussians.mean.size,
                 camera,
                 pose,
                 settings,
                 pass.tile_counts.data(),
                 pass.splats.data(),
                 workspace.splat_gradients.data(),
                 shard,
                 gaussians.filter_scale.data};
  constexpr int kRows = kGradientThreads * (Sink::kSkipsInvisible ? kGroupsOfWarp : 1);
  with_form(settings.sh_degree, gaussians, [&](auto degree, auto time) {
    context.launch("preprocess backward", preprocess_backward_kernel<degree(), time(), Sink>,
                   blocks_for(in.count, kRows), kGradientThreads, in, sink);
  });
}

// The statistics of a photo of so many pixels.
inline GatherStatistics gather_into(const DensityStatistics& statistics, const DensityStep& density,
                                    const RenderSettings& settings, int width, int height,
                                    const std::uint32_t* halted) {
  const bool adds_forces = sums_of_forces_are_added(settings);
  return {density.gather_statistics ? statistics.visits.data() : nullptr,
          statistics.gradient_norm.data(),
          width,
          height,
          halted,
          adds_forces ? statistics.sums.data() : nullptr,
          force_scale(std::size_t(width) * height)};
}
inline GatherStatistics gather_into(const DensityStatistics& statistics, const DensityStep& density,
                                    const RenderSettings& settings, const RenderPass& pass,
                                    const Workspace& workspace, const Shard& shard = {}) {
  return gather_into(statistics, density, settings, pass.width, pass.height,
                     shard.halted_or(workspace.halted.data()));
}

// The sink that updates the model: of(parameters, first and second moments, codes of both, step,
// place) of each quantity.
template <class Numbers, class Of>
UpdateByAdam<Numbers> update_of(const TrainingModel& model, const AdamSteps& steps,
                                const GatherStatistics& gather, bool is_absolute,
                                const Regularizers& of_each, Of&& of) {
  const GaussiansSpan rows = model.gaussians.span(), m = model.first_moment.span(),
                      v = model.second_moment.span();
  const MomentCodesSpan codes = model.codes.span();
  const NumberPlaces places = number_places();
  return {
      gather,
      of(rows.mean, m.mean, v.mean, codes.mean, steps.mean, places.mean),
      of(rows.log_scale, m.log_scale, v.log_scale, codes.log_scale, steps.log_scale,
         places.log_scale),
      of(rows.rotation, m.rotation, v.rotation, codes.rotation, steps.rotation, places.rotation),
      of(rows.logit_opacity, m.logit_opacity, v.logit_opacity, codes.logit_opacity,
         steps.logit_opacity, places.logit_opacity),
      of(rows.sh0, m.sh0, v.sh0, codes.sh0, steps.sh0, places.sh0),
      of(rows.sh_rest, m.sh_rest, v.sh_rest, codes.sh_rest, steps.sh_rest, places.sh_rest),
      of(rows.right_rotation, m.right_rotation, v.right_rotation, codes.right_rotation,
         steps.right_rotation, places.right_rotation),
      of(rows.time_mean, m.time_mean, v.time_mean, codes.time_mean, steps.time_mean,
         places.time_mean),
      of(rows.log_time_scale, m.log_time_scale, v.log_time_scale, codes.log_time_scale,
         steps.log_time_scale, places.log_time_scale),
      is_absolute,
      of_each.any(),
      of_each};
}

// Calls f(sink) with the sink that updates the model, whose moments are floats or codes.
template <class F>
void with_update(const TrainingModel& model, const AdamSteps& steps, const AdamRule& rule,
                 const MomentRounding& rounding, const DensityStep& density,
                 const RenderSettings& settings, const GatherStatistics& gather, const Shard& shard,
                 F&& f) {
  const bool is_absolute = density.gather_statistics && settings.absolute_gradient;
  const Regularizers of_each = density.regularizers.of_each(shard.count_of_all(model.count()));
  if (model.moment_form == MomentForm::tiny)
    f(update_of<AdamCodes>(
        model, steps, gather, is_absolute, of_each,
        [&](const auto& p, const auto&, const auto&, const auto& codes, const AdamStep& step,
            int place) {
          return AdamCodes{{numbers_of(p), numbers_of(codes)}, step, rule, rounding, place};
        }));
  else
    f(update_of<AdamNumbers>(
        model, steps, gather, is_absolute, of_each,
        [&](const auto& p, const auto& m, const auto& v, const auto&, const AdamStep& step, int) {
          return AdamNumbers{{numbers_of(p), numbers_of(m), numbers_of(v)}, step, rule};
        }));
}

}  // namespace gs::cuda
