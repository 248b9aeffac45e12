// SPDX-License-Identifier: Apache-2.0
// Stage 9 with model.filter_3d: each row's 3D filter, from all training cameras. A thread has a
// row; all threads of a warp read the same camera at a time.
#include "cuda/density/filter_3d.cuh"

#include "cuda/density/rows.cuh"
#include "gs_core/math/render/filter_3d.h"

namespace gs::cuda {
namespace {

// The filter of each row that a camera sees, 0 for others. Bits of positive floats are ordered like
// the floats, so that `largest` is their maximum.
__global__ void filter_kernel(Span<const Vec3f> means, Span<const Camera> cameras, float near_plane,
                              float* filter_scale, std::uint32_t* largest) {
  __shared__ std::uint32_t largest_of_block;
  if (threadIdx.x == 0) largest_of_block = 0;
  __syncthreads();
  const std::size_t i = row_of_thread();
  if (i < means.size) {
    const Vec3f mean = means[i];
    float rate = 0;
    for (std::size_t v = 0; v < cameras.size; ++v)
      rate = max_of(rate, sampling_rate(cameras[v], mean, near_plane));
    const float scale = rate > 0 ? filter_scale_of(rate) : 0.0f;
    filter_scale[i] = scale;
    atomicMax(&largest_of_block, __float_as_uint(scale));
  }
  __syncthreads();
  if (threadIdx.x == 0) atomicMax(largest, largest_of_block);
}

__global__ void unseen_kernel(Span<float> filter_scale, const std::uint32_t* largest) {
  const std::size_t i = row_of_thread();
  if (i < filter_scale.size && filter_scale[i] == 0) filter_scale[i] = __uint_as_float(*largest);
}

}  // namespace

void FilterMeter::measure(Gaussians& rows, const std::vector<Camera>& cameras, float near_plane) {
  const std::size_t count = rows.count();
  cameras_.upload(cameras);
  largest_.resize(1);
  largest_.fill_zero();
  rows.filter_scale.resize(count);
  rows.has_filter = true;
  launch_rows(context_, "filter", filter_kernel, count, rows.mean.span(), cameras_.span(),
              near_plane, rows.filter_scale.data(), largest_.data());
  launch_rows(context_, "filter", unseen_kernel, count, rows.filter_scale.span(), largest_.data());
}

}  // namespace gs::cuda
