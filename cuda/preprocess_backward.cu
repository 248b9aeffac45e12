// SPDX-License-Identifier: Apache-2.0
// Stages 7 and 8: from dL/d(splat) to the gradients of the parameters. In training the update
// follows at once, so that no gradient of a parameter is stored. A thread pulls the gradient of one
// Gaussian back. The whole warp then writes the gradients or updates the parameters, one number of
// its 32 rows after another, in whole cache lines. All loads are issued at the start, so that the
// warp waits for memory only once.   Faster-GS, backward fused with Adam
#include <algorithm>

#include "cuda/row_updates.cuh"
#include "cuda/sh_rows.cuh"
#include "cuda/stages.cuh"

namespace gs::cuda {
namespace {

// Two warps, each with shared memory of its own: ten fit a multiprocessor, with registers to spare.
constexpr int kThreads = 64;
constexpr int kBasisStride = kShBasisCount + 1;  // odd, so that 32 rows begin in different banks

struct alignas(16) WarpShared {
  float sh_rows[kMostArrays][kWarp * kShRowNumbers];  // parameters and moments
  union {
    RowNumbers numbers;                 // parameters at first, gradients in the end
    float basis[kWarp * kBasisStride];  // of the viewing direction of each Gaussian, between
  };
  float dL_dcolor[kWarp * 3];  // zero where a Gaussian is not visible
};

// dL/d(splat) of a visible Gaussian. Color gradients are zero where blending clamped the color.
__device__ SplatGradient masked(const SplatGradientSum& sum, const Vec3f& color) {
  return {sum.mean2d,
          {sum.conic_xx, sum.conic_xy, sum.conic_yy},
          sum.opacity,
          {color.x >= 0.0f ? sum.red : 0.0f, color.y >= 0.0f ? sum.green : 0.0f,
           color.z >= 0.0f ? sum.blue : 0.0f}};
}

// dL/d(number `number` of SH row `row` of the warp).
__device__ float sh_gradient(const WarpShared& shared, int row, int number) {
  return shared.basis[row * kBasisStride + 1 + number / 3] * shared.dL_dcolor[row * 3 + number % 3];
}

// The whole warp: starts to copy its SH rows into shared memory, so that they arrive during other
// work.
template <int degree, class Numbers>
__device__ void start_sh_rows(WarpShared& shared, const Numbers& numbers, std::size_t first,
                              int rows) {
  for (int a = 0; a < Numbers::kArrays; ++a)
    start_sh_copy<degree>(shared.sh_rows[a], numbers.arrays[a] + first * kShRowNumbers, rows);
  __pipeline_commit();
}

// The whole warp: applies the gradients to its SH rows, one number at a time.
template <int degree, class Numbers>
__device__ void finish_sh_numbers(WarpShared& shared, const Numbers& numbers, std::size_t first,
                                  int rows) {
  constexpr int kInUse = std::max(kShNumbersInUse<degree>, 1);
  for (int item = lane_of_thread(); item < rows * kInUse; item += kWarp) {
    const int row = item / kInUse, number = item % kInUse, at = row * kShRowNumbers + number;
    float loaded[Numbers::kArrays];
    for (int a = 0; a < Numbers::kArrays; ++a) loaded[a] = shared.sh_rows[a][at];
    numbers.finish(first * kShRowNumbers + at, loaded, sh_gradient(shared, row, number));
  }
}

// The same for 32 whole rows, four numbers at a time.
template <class Numbers>
__device__ void finish_sh_vectors(WarpShared& shared, const Numbers& numbers, std::size_t first) {
  const std::size_t base = first / 4 * kShRowNumbers;  // `first` is a multiple of 32
  for (int item = lane_of_thread(); item < kWarp * kShRowNumbers / 4; item += kWarp) {
    const int row = 4 * item / kShRowNumbers, number = 4 * item % kShRowNumbers;
    float gradient[4];
    for (int k = 0; k < 4; ++k) {
      const bool is_next = number + k >= kShRowNumbers;
      gradient[k] = sh_gradient(shared, row + is_next, number + k - (is_next ? kShRowNumbers : 0));
    }
    float4 loaded[Numbers::kArrays];
    for (int a = 0; a < Numbers::kArrays; ++a)
      loaded[a] = reinterpret_cast<const float4*>(shared.sh_rows[a])[item];
    numbers.finish(base + item, loaded, float4{gradient[0], gradient[1], gradient[2], gradient[3]});
  }
}

// The whole warp: pulls the color gradients back to the SH coefficients of its `rows` rows. Returns
// the part of dL/d(mean) that comes from the viewing direction.
template <int degree, class Numbers>
__device__ Vec3f color_backward(WarpShared& shared, const Vec3f& mean, const Camera& camera,
                                std::size_t first, int rows, bool is_visible,
                                const Vec3f& dL_dcolor, const Numbers& numbers) {
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
    finish_sh_vectors(shared, numbers, first);
  else
    finish_sh_numbers<degree>(shared, numbers, first, rows);
  if (!is_visible) return Vec3f(0.0f);
  const Vec3f* const row = reinterpret_cast<const Vec3f*>(shared.sh_rows[0] + lane * kShRowNumbers);
  float dL_dbasis[kShBasisCount];
  for (int k = 1; k < (degree + 1) * (degree + 1); ++k) dL_dbasis[k] = inner(row[k - 1], dL_dcolor);
  return unit_direction_vjp(camera.position(), mean, sh_basis_vjp(degree, direction, dL_dbasis));
}

// dL/d(parameters) of a visible Gaussian, without the color's part.
__device__ RowGradient pull_back(const Camera& camera, const Shape& shape,
                                 const SplatSettings& settings, const SplatGradient& dL_dsplat) {
  return {project_shape_vjp(camera, shape.mean, shape.log_scale, shape.rotation,
                            shape.logit_opacity, settings, dL_dsplat)};
}
// The same in space and time. `by_color` is the color's part of dL/d(mean at the moment).
__device__ RowGradient pull_back_in_time(const Camera& camera, const Shape& shape,
                                         const SplatSettings& settings,
                                         const SplatGradient& dL_dsplat, const Vec3f& by_color) {
  RowGradient gradient{};
  gradient.take(project_shape_vjp(camera, shape.in_spacetime(), time_of(camera, settings), settings,
                                  dL_dsplat, by_color));
  return gradient;
}

template <int degree, bool has_time, class Sink>
__global__ void __launch_bounds__(kThreads)
    preprocess_backward_kernel(std::size_t count, Camera camera, SplatSettings settings,
                               const std::uint32_t* tile_counts, const Splat* splats,
                               SplatGradientSum* sums, Sink sink) {
  __shared__ WarpShared shared_of_warps[kThreads / kWarp];
  WarpShared& shared = shared_of_warps[threadIdx.x / kWarp];
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  const std::size_t first = i - lane_of_thread();
  if (first >= count) return;  // the whole warp
  const int rows = int(min(count - first, std::size_t(kWarp)));
  if constexpr (Sink::kSkipsInvisible)
    if (!__any_sync(~0u, i < count && tile_counts[i] > 0)) return;
  // All loads come first, before any store, so that the warp waits for memory only once.
  if (degree > 0) start_sh_rows<degree>(shared, sink.sh_rest, first, rows);
  const bool is_halted = sink.is_halted(), is_row = i < count;
  Shares<Sink, has_time> shares(sink, first, rows);
  const typename Sink::Statistics statistics =
      is_row ? sink.load_statistics(i) : typename Sink::Statistics{};
  const SplatGradientSum sum = is_row ? load_in_vectors(sums + i) : SplatGradientSum{};
  const Vec3f color = is_row ? splats[i].color : Vec3f(0.0f);  // undefined where not visible
  const bool is_visible = is_row && tile_counts[i] > 0;
  if (is_visible) store_in_vectors(sums + i, SplatGradientSum{});  // clear for the next step
  if (is_halted) return;
  if constexpr (Sink::kSkipsInvisible)
    if (lane_of_thread() == 0) sink.touched[first / kWarp] = 1;

  const Shape shape = shares.row(shared.numbers, rows);
  SplatGradient dL_dsplat{};
  RowGradient gradient{};
  Vec2f by_mean2d(0.0f);
  if (is_visible) {
    dL_dsplat = masked(sum, color);
    by_mean2d = sink.by_mean2d(sum);
  }
  if constexpr (has_time) {
    // The color's part of the mean reaches the time, too, so that it comes first.
    const Vec3f mean =
        is_visible ? mean_at(shape.in_spacetime(), time_of(camera, settings)) : Vec3f(0.0f);
    const Vec3f by_color = color_backward<degree>(shared, mean, camera, first, rows, is_visible,
                                                  dL_dsplat.color, sink.sh_rest);
    if (is_visible) gradient = pull_back_in_time(camera, shape, settings, dL_dsplat, by_color);
  } else {
    if (is_visible) gradient = pull_back(camera, shape, settings, dL_dsplat);
    gradient.mean += color_backward<degree>(shared, shape.mean, camera, first, rows, is_visible,
                                            dL_dsplat.color, sink.sh_rest);
  }
  if (is_visible) gradient.sh0 = float(kSh0) * dL_dsplat.color;
  sink.template regularize<has_time>(shape, gradient);
  if (is_row) sink.note(i, statistics, by_mean2d, is_visible);
  __syncwarp();
  stage<has_time>(shared.numbers, gradient);
  __syncwarp();
  shares.finish(sink, first, rows, shared.numbers);
}

template <class Sink>
void launch(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
            const RenderSettings& settings, Workspace& workspace, RenderPass& pass,
            const Sink& sink) {
  with_form(settings.sh_degree, gaussians.has_time, [&](auto degree, auto has_time) {
    context.launch("preprocess backward", preprocess_backward_kernel<degree(), has_time(), Sink>,
                   blocks_for(gaussians.mean.size, kThreads), kThreads, gaussians.mean.size, camera,
                   settings, pass.tile_counts.data(), pass.splats.data(),
                   workspace.splat_gradients.data(), sink);
  });
}

GatherStatistics gather_into(const DensityStatistics& statistics, const DensityStep& density,
                             const RenderPass& pass, const Workspace& workspace) {
  return {density.gather_statistics ? statistics.visits.data() : nullptr,
          statistics.gradient_norm.data(), pass.width, pass.height, workspace.halted.data()};
}

}  // namespace

void preprocess_backward(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                         const RenderSettings& settings, Workspace& workspace, RenderPass& pass,
                         const GaussiansSpan& gradients, Span<Vec2f> dL_dmean2d) {
  const StageScope scope(context, "preprocess backward");
  if (settings.sh_degree < kMaxShDegree && gradients.sh_rest.size)  // degrees not in use have none
    check(cudaMemsetAsync(gradients.sh_rest.data, 0, gradients.sh_rest.size * sizeof(ShRest),
                          context.stream()),
          "preprocess backward");
  const auto numbers = [](const auto& rows, const auto& to) {
    return GradientNumbers{{numbers_of(rows)}, numbers_of(to)};
  };
  const WriteGradients sink{numbers(gaussians.mean, gradients.mean),
                            numbers(gaussians.log_scale, gradients.log_scale),
                            numbers(gaussians.rotation, gradients.rotation),
                            numbers(gaussians.logit_opacity, gradients.logit_opacity),
                            numbers(gaussians.sh0, gradients.sh0),
                            numbers(gaussians.sh_rest, gradients.sh_rest),
                            numbers(gaussians.right_rotation, gradients.right_rotation),
                            numbers(gaussians.time_mean, gradients.time_mean),
                            numbers(gaussians.log_time_scale, gradients.log_time_scale),
                            dL_dmean2d.data,
                            settings.absolute_gradient};
  launch(context, gaussians, camera, settings, workspace, pass, sink);
}

void preprocess_backward_and_add(Context& context, const GaussiansSpan& gaussians,
                                 const Camera& camera, const RenderSettings& settings,
                                 const DensityStep& density, Workspace& workspace, RenderPass& pass,
                                 float weight, const BatchSums& sums) {
  const StageScope scope(context, "preprocess backward");
  const GaussiansSpan to = sums.gradients.span();
  const auto numbers = [weight](const auto& rows, const auto& sum) {
    return SumNumbers{{numbers_of(rows), numbers_of(sum)}, weight};
  };
  const AddGradients sink{gather_into(sums.statistics, density, pass, workspace),
                          numbers(gaussians.mean, to.mean),
                          numbers(gaussians.log_scale, to.log_scale),
                          numbers(gaussians.rotation, to.rotation),
                          numbers(gaussians.logit_opacity, to.logit_opacity),
                          numbers(gaussians.sh0, to.sh0),
                          numbers(gaussians.sh_rest, to.sh_rest),
                          numbers(gaussians.right_rotation, to.right_rotation),
                          numbers(gaussians.time_mean, to.time_mean),
                          numbers(gaussians.log_time_scale, to.log_time_scale),
                          settings.absolute_gradient,
                          sums.touched.data()};
  launch(context, gaussians, camera, settings, workspace, pass, sink);
}

void preprocess_backward_and_update(Context& context, TrainingModel& model, const Camera& camera,
                                    const RenderSettings& settings, const AdamSteps& steps,
                                    const DensityStep& density, Workspace& workspace,
                                    RenderPass& pass) {
  const StageScope scope(context, "preprocess backward, Adam");
  const GaussiansSpan rows = model.gaussians.span(), m = model.first_moment.span(),
                      v = model.second_moment.span();
  const auto numbers = [](const auto& rows, const auto& m, const auto& v, const AdamStep& step) {
    return AdamNumbers{{numbers_of(rows), numbers_of(m), numbers_of(v)}, step};
  };
  const UpdateByAdam sink{
      gather_into(model.statistics, density, pass, workspace),
      numbers(rows.mean, m.mean, v.mean, steps.mean),
      numbers(rows.log_scale, m.log_scale, v.log_scale, steps.log_scale),
      numbers(rows.rotation, m.rotation, v.rotation, steps.rotation),
      numbers(rows.logit_opacity, m.logit_opacity, v.logit_opacity, steps.logit_opacity),
      numbers(rows.sh0, m.sh0, v.sh0, steps.sh0),
      numbers(rows.sh_rest, m.sh_rest, v.sh_rest, steps.sh_rest),
      numbers(rows.right_rotation, m.right_rotation, v.right_rotation, steps.right_rotation),
      numbers(rows.time_mean, m.time_mean, v.time_mean, steps.time_mean),
      numbers(rows.log_time_scale, m.log_time_scale, v.log_time_scale, steps.log_time_scale)};
  const bool is_absolute = density.gather_statistics && settings.absolute_gradient;
  if (is_absolute || density.regularizers.any())
    launch(context, rows, camera, settings, workspace, pass,
           UpdateByAdamAsAsked{sink, is_absolute, density.regularizers.of_each(model.count())});
  else
    launch(context, rows, camera, settings, workspace, pass, sink);
}

}  // namespace gs::cuda
