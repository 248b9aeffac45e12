// SPDX-License-Identifier: Apache-2.0
// Stage 7 of the operator: from dL/d(splat) to the gradients of all that the caller has given, in the
// forms in which it was given, and of the camera. A thread pulls the gradient of one Gaussian back.
// The whole warp writes the rows of SH coefficients, in whole lines. Sums over all Gaussians, those
// of the camera, are of double precision, in an order of their own.
#include "cuda/device/block_sums.cuh"
#include "cuda/operator/given_rows.cuh"
#include "cuda/operator/sh_layout.cuh"
#include "cuda/operator/stages.cuh"
#include "gs_core/math/pose/camera_entries.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 128;
constexpr int kWarps = kThreads / kWarp;
constexpr int kBlocks = 5;                       // per multiprocessor, as many as registers allow
constexpr int kBasisStride = kShBasisCount + 1;  // odd, so that 32 rows begin in different banks
constexpr int kCameraNumbers = sizeof(CameraEntriesGradient<float>) / sizeof(float);
static_assert(kCameraNumbers == 16);

template <ShLayout layout>
struct WarpShared {
  GivenShRows<layout> sh;
  // of the viewing direction of each Gaussian; zero where it is not visible, and beyond the degree
  float basis[kWarp * kBasisStride];
  float dL_dcolor[kWarp * 3];

  /// dL by a number of the SH coefficients, 3 k + channel.
  __device__ float gradient(int row, int number) const {
    return basis[row * kBasisStride + number / 3] * dL_dcolor[3 * row + number % 3];
  }
};
template <>
struct WarpShared<ShLayout::none> {};

// What stages 1 and 6 have left.
struct Projected {
  const std::uint32_t* tile_counts;  // (N)
  const Splat* splats;               // (N)
  const SplatGradientSum* sums;      // (N)
  const std::uint32_t* overflowed;   // (1)  may be null
};

// Where gradients go.
struct Targets : OperatorGradients {
  bool has_vectors;  // SH gradients lie as the coefficients do
};

// Writes a vector where a gradient is wanted.
__device__ void write(const OperatorRows<float>& to, std::size_t i, const Vec3f& gradient) {
  if (to.data) store(to[i], gradient);
}

// The gradients of a Gaussian but those of SH and of the camera; all zero where it is not visible.
struct RowGradient {
  Vec3f mean{0.0f}, scale{0.0f}, sh0_or_color{0.0f};
  Quatf rotation{0, 0, 0, 0};
  Sym3<float> sigma{0, 0, 0, 0, 0, 0};
  float opacity = 0;
  Vec2f screen{0, 0}, absolute_screen{0, 0};

  __device__ void write_to(const Targets& to, std::size_t i) const {
    write(to.arrays.means, i, mean);
    write(to.arrays.scales, i, scale);
    write(to.arrays.colors, i, sh0_or_color);
    write(to.arrays.sh0, i, sh0_or_color);
    if (to.arrays.rotations.data) {
      float* const row = to.arrays.rotations[i];
      row[0] = rotation.w, row[1] = rotation.x, row[2] = rotation.y, row[3] = rotation.z;
    }
    if (to.arrays.covariances.data) {  // off the diagonal a stored number stands at two places
      float* const row = to.arrays.covariances[i];
      row[0] = sigma.xx, row[1] = 2 * sigma.xy, row[2] = 2 * sigma.xz;
      row[3] = sigma.yy, row[4] = 2 * sigma.yz, row[5] = sigma.zz;
    }
    if (to.arrays.opacities.data) *to.arrays.opacities[i] = opacity;
    if (to.arrays.screen.data) store(to.arrays.screen[i], screen);
    if (to.absolute_screen) store(to.absolute_screen + 2 * i, absolute_screen);
  }
};

// The gradient by the shape, in the form in which it was given.
__device__ void pull_back_shape(const OperatorInput& in, const GivenShape& shape,
                                const EllipsoidInCameraGradient<float>& dL, RowGradient& row) {
  row.opacity = in.has_logit_opacities ? sigmoid_vjp(shape.opacity, dL.opacity) : dL.opacity;
  row.sigma = dL.sigma;
  if (in.arrays.covariances.data) return;
  const CovarianceGradient<float> by_shape = covariance_vjp(shape.R, shape.variances, dL.sigma);
  row.scale = in.has_log_scales ? variance_vjp(shape.variances, by_shape.variance)
                                : 2.0f * shape.scale * by_shape.variance;
  row.rotation = rotation_matrix_vjp(shape.rotation, by_shape.R);
}

// The whole warp: writes the gradients of its rows of SH coefficients.
template <ShLayout layout>
__device__ void write_sh(const OperatorInput& in, const Targets& to, int degree, std::size_t first,
                         const WarpShared<layout>& shared) {
  using Shape = ShRowShape<layout>;
  if (!to.arrays.sh_rest.data) return;
  const int lane = lane_of_thread(), rows = int(min(in.count - first, std::size_t(kWarp)));
  constexpr int kBefore = 3 - Shape::kFirst;  // numbers that are elsewhere
  if (Shape::kIsVector && to.has_vectors && rows == kWarp) {
    auto* const out = reinterpret_cast<float4*>(
        (Shape::kFirst ? to.arrays.sh0.data : to.arrays.sh_rest.data) + first * Shape::kNumbers);
    for (int item = lane; item < kWarp * Shape::kNumbers / 4; item += kWarp) {
      const int row = 4 * item / Shape::kNumbers, at = 4 * item % Shape::kNumbers;
      float of[4];
#pragma unroll
      for (int k = 0; k < 4; ++k) {
        const bool is_next = at + k >= Shape::kNumbers;
        of[k] = shared.gradient(row + is_next, kBefore + at + k - (is_next ? Shape::kNumbers : 0));
      }
      out[item] = {of[0], of[1], of[2], of[3]};
    }
    return;
  }
  const int in_use = 3 * sh_rest_count(degree);
  for (int row = 0; row < rows; ++row)
    for (int k = lane; k < in_use; k += kWarp)
      to.arrays.sh_rest[first + row][k] = shared.gradient(row, 3 + k);
}

// The whole warp: pulls the gradients of the colors back to the SH coefficients, which it writes, and
// returns the part of dL/d(mean) that comes from the viewing direction.
template <ShLayout layout>
__device__ Vec3f pull_back_sh(const OperatorInput& in, const Targets& to, int degree,
                              const Vec3f& eye, const Vec3f& mean, const Vec3f& dL_dcolor,
                              bool is_visible, std::size_t first, WarpShared<layout>& shared) {
  const int lane = lane_of_thread();
  Vec3f direction(0.0f);
  float basis[kShBasisCount] = {};
  if (is_visible) {
    direction = unit_direction(eye, mean);
    sh_basis(kMaxShDegree, direction, basis);
  }
#pragma unroll
  for (int k = 0; k < kShBasisCount; ++k)
    shared.basis[lane * kBasisStride + k] = k <= sh_rest_count(degree) ? basis[k] : 0.0f;
  store(shared.dL_dcolor + 3 * lane, dL_dcolor);
  shared.sh.finish(degree);
  write_sh(in, to, degree, first, shared);
  if (!is_visible) return Vec3f(0.0f);
  float dL_dbasis[kShBasisCount];
#pragma unroll
  for (int k = 1; k < kShBasisCount; ++k)
    dL_dbasis[k] = inner(shared.sh.row(lane)[k - 1], dL_dcolor);
  return unit_direction_vjp(eye, mean, sh_basis_vjp(kMaxShDegree, direction, dL_dbasis));
}

// `of_blocks`: (blocks, kCameraNumbers), where the gradient of the camera is wanted.
template <ShLayout layout, bool with_camera, bool has_lens>
__global__ void __launch_bounds__(kThreads, has_lens ? 1 : kBlocks)
    project_backward_kernel(const __grid_constant__ OperatorInput in,
                            const __grid_constant__ SplatSettings settings, Projected projected,
                            const __grid_constant__ Targets to, double* of_blocks) {
  constexpr bool has_sh = layout != ShLayout::none;
  __shared__ WarpShared<layout> shared_of_warps[kWarps];
  [[maybe_unused]] WarpShared<layout>& shared = shared_of_warps[threadIdx.x / kWarp];
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x,
                    first = i - lane_of_thread();
  const Camera camera = camera_of<has_lens>(in);
  const bool has_overflowed = projected.overflowed && *projected.overflowed;
  const bool is_visible = !has_overflowed && i < in.count && projected.tile_counts[i] > 0;
  if constexpr (has_sh) {
    const SomeRows visible{__ballot_sync(kAllLanes, is_visible)};
    if (first < in.count)
      shared.sh.start(in.arrays, first, int(min(in.count - first, std::size_t(kWarp))),
                      settings.sh_degree, visible);
  }
  RowGradient row;
  CameraEntriesGradient<float> by_camera;
  Vec3f mean(0.0f), dL_dcolor(0.0f);
  if (is_visible) {
    mean = vector_at(in.arrays.means[i]);
    const SplatGradientSum sum = load_in_vectors(projected.sums + i);
    SplatGradient dL_dsplat = masked(sum, has_sh ? projected.splats[i].color : Vec3f(0.0f));
    dL_dcolor = dL_dsplat.color;
    if (in.has_inverse_depth) {
      const float inverse = projected.splats[i].depth;
      dL_dsplat.depth *= -inverse * inverse;
    }
    const GivenShape shape = shape_of(in, i);
    const EllipsoidInCameraGradient<float> dL = project_ellipsoid_in_camera_vjp(
        camera, to_camera(camera, mean), shape.sigma, shape.opacity, settings, dL_dsplat);
    row.mean = to_camera_vjp(camera, dL.p);
    row.sh0_or_color = has_sh ? float(kSh0) * dL_dcolor : dL_dcolor;
    row.screen = dL_dsplat.mean2d;
    row.absolute_screen = {sum.absolute_x, sum.absolute_y};
    pull_back_shape(in, shape, dL, row);
    if (with_camera) by_camera = camera_entries_vjp(camera, mean, dL, dL_dsplat.mean2d);
  }
  if constexpr (has_sh)
    if (first < in.count) {
      const Vec3f by_color = pull_back_sh(in, to, settings.sh_degree, camera.position(), mean,
                                          dL_dcolor, is_visible, first, shared);
      row.mean += by_color;
      if (with_camera && is_visible) by_camera.add(camera_entries_by_color_vjp(camera, by_color));
    }
  if (i < in.count) row.write_to(to, i);
  if constexpr (with_camera) {
    __shared__ double of_warps[kWarps][kCameraNumbers];
    sum_of_block(reinterpret_cast<const float(&)[kCameraNumbers]>(by_camera), of_warps,
                 of_blocks + kCameraNumbers * blockIdx.x);
  }
}

// Thread t takes the blocks t, t + kThreads, ...
__global__ void __launch_bounds__(kThreads)
    add_blocks_kernel(const double* of_blocks, std::size_t blocks, float* viewmat, float* K) {
  __shared__ double n[kCameraNumbers], of_warps[kWarps][kCameraNumbers];
  double shares[kCameraNumbers] = {};
  for (std::size_t block = threadIdx.x; block < blocks; block += kThreads)
    for (int k = 0; k < kCameraNumbers; ++k) shares[k] += of_blocks[kCameraNumbers * block + k];
  sum_of_block(shares, of_warps, n);
  __syncthreads();
  if (threadIdx.x != 0) return;
  if (viewmat) {
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column)
        viewmat[4 * row + column] = float(n[3 * row + column]);
      viewmat[4 * row + 3] = float(n[9 + row]);
    }
    for (int k = 12; k < 16; ++k) viewmat[k] = 0;
  }
  if (K) {
    for (int k = 0; k < 9; ++k) K[k] = 0;
    K[0] = float(n[12]), K[4] = float(n[13]), K[2] = float(n[14]), K[5] = float(n[15]);
  }
}

}  // namespace

void project_backward(Context& context, const OperatorInput& input, const RenderSettings& settings,
                      Workspace& workspace, const RenderPass& pass, const std::uint32_t* overflowed,
                      const OperatorGradients& gradients) {
  const StageScope scope(context, "project backward");
  const std::size_t blocks = blocks_for(input.count, kThreads);
  const Projected projected{pass.tile_counts.data(), pass.splats.data(),
                            workspace.splat_gradients.data(), overflowed};
  const SplatSettings& splat_settings = settings;
  const ShLayout layout = layout_of(input.arrays, settings.sh_degree);
  const Targets targets{gradients, layout_of(gradients.arrays, settings.sh_degree) == layout};
  const auto launch = [&](auto pinhole, auto lens, double* of_blocks) {
    context.launch("project backward", input.camera.has_lens() ? lens : pinhole, blocks, kThreads,
                   input, splat_settings, projected, targets, of_blocks);
  };
  if (!gradients.viewmat && !gradients.K)
    return with_layout(layout, [&](auto layout) {
      launch(project_backward_kernel<layout(), false, false>,
             project_backward_kernel<layout(), false, true>, nullptr);
    });
  Buffer<double> of_blocks(workspace.splat_gradients.memory());
  of_blocks.resize(kCameraNumbers * blocks);
  with_layout(layout, [&](auto layout) {
    launch(project_backward_kernel<layout(), true, false>,
           project_backward_kernel<layout(), true, true>, of_blocks.data());
  });
  context.launch("camera gradient", add_blocks_kernel, 1, kThreads, of_blocks.data(), blocks,
                 gradients.viewmat, gradients.K);
}

}  // namespace gs::cuda
