// SPDX-License-Identifier: Apache-2.0
// Stage 10: order the rows along the Morton curve, so that neighbors in space are neighbors in
// memory.   Faster-GS
#include "gs_core/math/density/morton.h"

#include <thrust/iterator/transform_iterator.h>

#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_reduce.cuh>
#include <limits>

#include "cuda/density/rows.cuh"
#include "cuda/device/cub_scratch.cuh"

namespace gs::cuda {
namespace {

constexpr float kFar = 1e30f;  // world units; corners of an empty box, as in the scalar twin

/// The box of one point. An axis on which the point is not finite stays empty.
struct BoundsOf {
  __device__ Bounds operator()(const Vec3f& point) const {
    Bounds bounds{Vec3f(kFar), Vec3f(-kFar)};
    for (int axis = 0; axis < 3; ++axis) {
      const float p = point[axis];
      if (p - p != 0.0f) continue;  // infinite or NaN
      bounds.low[axis] = min_of(bounds.low[axis], p);
      bounds.high[axis] = max_of(bounds.high[axis], p);
    }
    return bounds;
  }
};

/// The box around two boxes.
struct JoinBounds {
  __device__ Bounds operator()(const Bounds& a, const Bounds& b) const {
    Bounds joined;
    for (int axis = 0; axis < 3; ++axis) {
      joined.low[axis] = min_of(a.low[axis], b.low[axis]);
      joined.high[axis] = max_of(a.high[axis], b.high[axis]);
    }
    return joined;
  }
};

/// Writes the box around all finite points to *bounds. DeviceReduce::TransformReduce came with CUB
/// 2.4 (CUDA 12.5); before it, Reduce reads the same boxes through an iterator.
cudaError_t reduce_to_bounds(void* scratch, std::size_t& bytes, Span<const Vec3f> means,
                             Bounds* bounds, cudaStream_t stream) {
  const Bounds empty{Vec3f(kFar), Vec3f(-kFar)};
#if CUB_VERSION >= 200400 && !defined(GS_FORCE_PORTABLE_CUB)
  return cub::DeviceReduce::TransformReduce(scratch, bytes, means.data, bounds, int(means.size),
                                            JoinBounds{}, BoundsOf{}, empty, stream);
#else
  return cub::DeviceReduce::Reduce(scratch, bytes,
                                   thrust::make_transform_iterator(means.data, BoundsOf{}), bounds,
                                   int(means.size), JoinBounds{}, empty, stream);
#endif
}

__global__ void morton_kernel(Span<const Vec3f> means, Span<const float> time_means,
                              Span<const float> log_time_scales, const Bounds* bounds,
                              Span<std::uint64_t> codes) {
  const std::size_t i = row_of_thread();
  if (i >= means.size) return;
  const Vec3f edges = bounds->high - bounds->low;
  const float size =
      max_of(max_of(edges.x, edges.y), max_of(edges.z, std::numeric_limits<float>::min()));
  const std::uint64_t code = morton_code(means[i], bounds->low, size);
  codes[i] = time_means.empty() ? code : spacetime_code(code, time_means[i], log_time_scales[i]);
}

__global__ void row_numbers_kernel(Span<std::uint32_t> row_numbers) {
  const std::size_t i = row_of_thread();
  if (i < row_numbers.size) row_numbers[i] = std::uint32_t(i);
}

}  // namespace

Span<const std::uint32_t> RowOrderWorkspace::sort(Context& context, const char* stage, int bits) {
  const std::size_t count = keys_.size;
  if (count == 0) return {};
  std::uint32_t* const row_numbers = borrowed_.row_numbers(count);
  launch_rows(context, stage, row_numbers_kernel, count, Span<std::uint32_t>{row_numbers, count});
  cub::DoubleBuffer<std::uint64_t> keys(keys_.data, keys_.data + count);
  cub::DoubleBuffer<std::uint32_t> rows(row_numbers, row_numbers + count);
  with_cub_scratch(cub, stage, [&](void* scratch, std::size_t& bytes) {
    return cub::DeviceRadixSort::SortPairs(scratch, bytes, keys, rows, int(count), 0, bits,
                                           context.stream());
  });
  return {rows.Current(), count};
}

void RowOrderWorkspace::release() {
  keys_ = {};
  bounds.release();
  cub.release();
}

Span<const std::uint32_t> morton_order(Context& context, RowOrderWorkspace& workspace,
                                       Span<const Vec3f> means, Span<const float> time_means,
                                       Span<const float> log_time_scales) {
  const Span<std::uint64_t> keys = workspace.make_keys(means.size);
  if (means.empty()) return {};
  workspace.bounds.resize_discard(1);
  with_cub_scratch(workspace.cub, "morton", [&](void* scratch, std::size_t& bytes) {
    return reduce_to_bounds(scratch, bytes, means, workspace.bounds.data(), context.stream());
  });
  launch_rows(context, "morton", morton_kernel, means.size, means, time_means, log_time_scales,
              workspace.bounds.data(), keys);
  return workspace.sort(context, "morton", 3 * kMortonBits);
}

}  // namespace gs::cuda
