// SPDX-License-Identifier: Apache-2.0
// The settings of a render and what each stage leaves behind, in stage order. All backends fill the
// same fields, so that a parity test can compare them after every stage.
#pragma once

#include <memory>

#include "gs_core/buffer.h"
#include "gs_core/error.h"
#include "gs_core/math/render/blend.h"
#include "gs_core/math/render/ray_depth.h"
#include "gs_core/math/render/splat.h"
#include "gs_core/math/render/surface.h"

namespace gs {

/// What backward sums over the fragments of each Gaussian besides gradients (FragmentSums).
enum class FragmentStatistic { none, force };

/// How to render. It is passed by value with each call; there is no global state.
struct RenderSettings : SplatSettings {
  Vec3f background{0, 0, 0};  // sRGB 0..1
  // (3) in the memory of a GPU, where the CUDA backend reads it; null: `background` counts
  const float* background_on_device = nullptr;
  BlendRule blend_rule = BlendRule::faster_gs;
  RenderOrder order = RenderOrder::z;
  // backward's dL_dmean2d sums absolute values over pixels (Ye et al. 2024, AbsGS)
  bool absolute_gradient = false;
  FragmentStatistic fragment_statistic = FragmentStatistic::none;
  // (H, W) in the renderer's memory: tiles whose pixels are all 0 have no list, and show the
  // background. For callers who use no such pixel. null: all tiles are drawn
  const std::uint8_t* mask = nullptr;
  bool blends_depth = false;  // also sum the depths of splats, into RenderPass::depth_image
  // Also sum the surfaces of splats, into RenderPass::surface_image. For Gaussians without time,
  // cameras without a lens, and the order by depth.
  bool blends_surface = false;
  // How the CUDA backend blends; the scalar one ignores these.
  // where the GPU has them: exponents as matrix products, blend_gemm.cu
  bool use_tensor_cores = true;
  bool for_backward = true;  // false: what only the backward pass reads may be skipped
  // sums that do not depend on their order, so that a step has one result
  bool deterministic = false;
};

/// An entry of a tile's list holds a Gaussian in its lower bits. On the GPU the upper ones say
/// which parts of the tile its splat hits (hit_parts_of_row), four bits for a tile of 16 pixels and
/// nine for one of 24; the scalar backend leaves them 0.
template <int edge = kTileWidth>
inline constexpr int kGaussianBits = 32 - kPartsAcross<edge>* kPartsAcross<edge>;
template <int edge = kTileWidth>
inline constexpr std::uint32_t kMostListed = 1u << kGaussianBits<edge>;
// more than any GPU of today has memory for
inline constexpr std::uint32_t kMostGaussians = kMostListed<>;
template <int edge = kTileWidth>
GS_HD std::uint32_t instance_of(std::uint32_t gaussian, unsigned parts) {
  return gaussian | parts << kGaussianBits<edge>;
}
template <int edge = kTileWidth>
GS_HD std::uint32_t gaussian_of(std::uint32_t instance) {
  return instance & (kMostListed<edge> - 1);
}
template <int edge = kTileWidth>
GS_HD std::uint32_t bit_of_part(int part) {
  return 1u << (kGaussianBits<edge> + part);
}

/// What the stages of one backend keep with a pass besides the fields below: what forward leaves
/// for its own backward pass, and scratch. Each backend derives its own, for example ScalarScratch
/// in stages.h.
struct BackendScratch {
  virtual ~BackendScratch() = default;
};

/// dL by a picture. That by the image alone may be given as its Span.
struct PictureGradient {
  Span<const float> image;         // (3, H, W)
  Span<const float> alpha;         // (H, W)  by 1 - transmittance; empty: zeros
  Span<const float> depth;         // (H, W)  by RenderPass::depth_image; empty: zeros
  Span<const SurfaceRow> surface;  // (H, W)  by RenderPass::surface_image; empty: zeros

  PictureGradient() = default;
  PictureGradient(Span<float> image_) : image(image_) {}
  PictureGradient(Span<const float> image_, Span<const float> alpha_ = {},
                  Span<const float> depth_ = {})
      : image(image_), alpha(alpha_), depth(depth_) {}
};

// clang-format off
/// The output of every stage that backends have in common. Filled by forward, consumed by backward;
/// reused from step to step, so that a steady run allocates nothing.
struct RenderPass {
  int width = 0, height = 0;            // pixels
  int tile_edge = kTileWidth;           // pixels; kWideTile in some frames of the CUDA backend
  int tiles_x = 0, tiles_y = 0;
  Vec3f background{0, 0, 0};            // behind the image
  // The CUDA backend raises lower colors to it; -infinity: colors are blended as they are.
  float least_color = 0;

  // 1 preprocess                       one row per Gaussian; of culled ones only tile_counts is defined
  Buffer<Splat> splats;                 // (N)
  Buffer<Rect> pixel_rects;             // (N)   pixels of the bounding rectangle
  Buffer<std::uint32_t> tile_counts;    // (N)   tiles hit; 0 = culled
  Buffer<RayDepth<float>> ray_depths;   // (N)   in the order by pixel; else empty

  // 2 depth order and instances        V visible Gaussians, I instances
  Buffer<std::uint32_t> depth_order;    // (V)   visible Gaussians, near to far, equal depths by index

  // 3 tile order                       each tile's instances, front to back; not those of masked tiles
  Buffer<std::uint32_t> tile_splats;    // (I)   their Gaussians (gaussian_of), sorted by tile, stable
  Buffer<std::uint32_t> tile_ranges;    // (tiles+1) tile t owns tile_splats[ranges[t] .. ranges[t+1])

  // 4 blend
  Buffer<float> image;                  // (3, H, W) with background, not clamped
  Buffer<float> transmittance;          // (H, W)    what is left for the background
  Buffer<float> depth_image;            // (H, W)    sum of weights times Splat::depth; only if blends_depth
  Buffer<std::uint32_t> last_instance;  // (H, W)    1 + position in its tile's list of the last blended; 0 = none.
                                        //           In the order by pixel how many were blended
  Buffer<SurfaceRow> surface_rows;      // (N)       of visible Gaussians; only if blends_surface
  Buffer<SurfaceRow> surface_image;     // (H, W)    sum of weights times rows; only if blends_surface

  explicit RenderPass(Memory& memory = host_memory())
      : splats(memory), pixel_rects(memory), tile_counts(memory), ray_depths(memory),
        depth_order(memory), tile_splats(memory), tile_ranges(memory), image(memory),
        transmittance(memory), depth_image(memory), last_instance(memory), surface_rows(memory),
        surface_image(memory) {}

  /// The scratch of one backend, made when it is first asked for.
  template <class Scratch>
  Scratch& scratch() {
    auto* mine = dynamic_cast<Scratch*>(scratch_.get());
    if (mine) return *mine;
    scratch_ = std::make_unique<Scratch>(image.memory());
    return static_cast<Scratch&>(*scratch_);
  }
  /// The scratch of a backend where an earlier stage has made it.
  template <class Scratch>
  const Scratch& scratch() const {
    const auto* const mine = dynamic_cast<const Scratch*>(scratch_.get());
    GS_CHECK(mine);
    return *mine;
  }

  /// Sizes what stage 1 fills, for a view and so many Gaussians. `with_splats` false: the backend
  /// keeps splats in a form of its own.
  void begin(const Camera& camera, std::size_t gaussians, bool with_splats = true,
             int edge = kTileWidth) {
    GS_CHECK(camera.width > 0 && camera.width <= kMaxPictureSide && camera.height > 0 &&
             camera.height <= kMaxPictureSide);
    width = camera.width;
    height = camera.height;
    tile_edge = edge;
    tiles_x = (camera.width + edge - 1) / edge;
    tiles_y = (camera.height + edge - 1) / edge;
    splats.resize_discard(with_splats ? gaussians : 0);
    pixel_rects.resize_discard(gaussians);
    tile_counts.resize_discard(gaussians);
    ray_depths.resize_discard(0);
  }

  std::size_t pixel_count() const { return std::size_t(width) * height; }
  std::size_t tile_count() const { return std::size_t(tiles_x) * tiles_y; }

 private:
  std::unique_ptr<BackendScratch> scratch_;
};
// clang-format on

}  // namespace gs
