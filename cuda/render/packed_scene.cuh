// SPDX-License-Identifier: Apache-2.0
// Gaussians as frames for viewing read them (Renderer::pack): in place of parameters what every
// view of them begins with. A Gaussian of SH degree 3 takes 152 bytes, and preprocess reads the 112
// of its color only where it may be visible. Models in space and time have another shape at each
// moment and are not packed; frames through a lens, and those that are not blended on tensor cores,
// are drawn from the model.
#pragma once

#include "cuda/stages.cuh"
#include "gs_core/math/view/view_box.h"

namespace gs::cuda {

/// Rows that share a box, and are preprocessed by one block of threads.
inline constexpr int kRowsOfBox = 128;

/// The color of one Gaussian: SH beyond degree 0 in 16 bits with one scale (packed_sh.h). Copied 16
/// bytes at a time.
template <int degree>
struct alignas(16) ColorRow {
  Vec3f sh0;
  float scale;
  std::int16_t rest[3 * sh_rest_count(degree)];
};
template <>
struct alignas(16) ColorRow<0> {
  Vec3f sh0;
};
static_assert(sizeof(ColorRow<3>) == 112);

/// A packed model in device memory.
class CudaPackedScene final : public PackedScene {
 public:
  CudaPackedScene(Context& context, Memory& memory, const GaussiansSpan& gaussians,
                  const RenderSettings& settings);

  std::size_t count() const { return ellipsoids.size(); }
  /// True where frames with these settings can be drawn from it.
  bool serves(const Context& context, const RenderSettings& settings) const {
    return !settings.for_backward && settings.sh_degree == sh_degree &&
           blends_on_tensor_cores(context, settings);
  }

  int sh_degree;
  Buffer<Ellipsoid> ellipsoids;  // (N)
  Buffer<Box3> boxes;            // (N / kRowsOfBox, rounded up)
  Buffer<float4> colors;         // (N) ColorRows of sh_degree
};

/// 1  packed_scene.cu: preprocess() of a packed model. The pass gets no depths.
void preprocess(Context& context, const CudaPackedScene& scene, const Camera& camera,
                const RenderSettings& settings, Workspace& workspace, RenderPass& pass);

}  // namespace gs::cuda
