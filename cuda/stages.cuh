// SPDX-License-Identifier: Apache-2.0
// The CUDA stages in pipeline order: the table of contents, like gs_render/stages.h and
// gs_train/stages/scalar_stages.h for the scalar stages. Each function only launches kernels. None
// waits, and none allocates once its buffers have grown.
#pragma once

#include <functional>
#include <memory>

#include "cuda/device/context.cuh"
#include "cuda/device/fixed_sums.cuh"
#include "cuda/gpus/shard.h"
#include "cuda/gradients/fragment_sums.cuh"
#include "cuda/photo_terms/poses.cuh"
#include "cuda/render/refined_camera.cuh"
#include "cuda/step/photos.cuh"
#include "gs_core/math/density/pixel_rule.h"
#include "gs_core/math/update/adam.h"
#include "gs_core/math/update/moment_rounding.h"
#include "gs_core/math/view/view_splat.h"
#include "gs_render/operator.h"
#include "gs_render/renderer.h"
#include "gs_train/row_ops.h"
#include "gs_train/step.h"
#include "gs_train/training_model.h"

namespace gs::cuda {

/// The device's message to the host about one step, or one frame. create_instances() writes it; the
/// host reads it later.
struct StepReport {
  std::uint32_t instances;  // of the view
  std::uint32_t halted;     // 1: this step or an earlier one had more instances than capacity
  std::uint32_t unused;
  std::uint32_t step;  // number of the step, written last
};

/// A piece of a tile's list.
struct ListSegment {
  std::uint32_t tile;    // kNoTile: none
  std::uint32_t number;  // within the list: 0, 1, ...
};
inline constexpr std::uint32_t kNoTile = 0xffffffffu;

// clang-format off
/// What stages leave with a RenderPass: 1 the splats of a packed model, 3 and 4 for blending the
/// order of the tiles, and the lists in segments that the backward pass can walk independently.
struct CudaScratch final : BackendScratch {
  bool has_view_splats = false;             // stage 1 has filled view_splats in place of pass.splats
  Buffer<ViewSplat> view_splats;            // (N) of frames of a packed model
  Buffer<std::uint32_t> tile_order;         // (tiles) those with the longest lists first; empty: as they are numbered
  Buffer<std::uint32_t> first_checkpoints;  // (tiles) a tile's first checkpoint; one per segment but the first
  Buffer<ListSegment> segments;             // (capacity S) the longest first, then empty ones
  Buffer<Vec4f> instance_buffer;                       // of the sorts, and then of the checkpoints (instance_buffer.cuh)
  Buffer<float> depth_checkpoints;                     // (S - tiles, pixels of a tile) sum of depths before a segment

  /// The order of the tiles; null where they are blended as they are numbered. An empty Buffer may
  /// still point to the order of an earlier, smaller picture.
  const std::uint32_t* order() const { return tile_order.empty() ? nullptr : tile_order.data(); }
  /// (S - tiles, pixels of a tile) color and transmittance before a segment
  Vec4f* checkpoints() const { return instance_buffer.data(); }

  explicit CudaScratch(Memory& memory)
      : view_splats(memory), tile_order(memory), first_checkpoints(memory), segments(memory),
        instance_buffer(memory), depth_checkpoints(memory) {}
};
// clang-format on

// clang-format off
/// The buffers that one render needs besides the RenderPass: scratch of the sorts, and what the
/// GPU's stages pass to each other.
struct Workspace {
  Buffer<std::uint32_t> depth_keys;       // (N)   culled ones behind all others
  // 0, 1, 2, ... if are_numbered; where few of many Gaussians are visible, the visible rows before
  // the culled ones
  Buffer<std::uint32_t> rows;             // (N)
  bool are_numbered = false;
  // Where few of many Gaussians are visible; empty elsewhere.
  Buffer<std::uint32_t> visible_count;    // (1)
  Buffer<std::uint32_t> taken_depth_keys; // (M)   of the first M of these rows
  // (N or M)  first instance of each Gaussian in depth order; before that, its sorted depth keys
  Buffer<std::uint32_t> first_of_order;
  Buffer<Vec4f> instance_buffer;                // as CudaScratch::instance_buffer, for passes without segments
  Buffer<std::uint32_t> length_classes;   // (2, classes) tiles whose lists are about as long: all, and ordered so far
  Buffer<std::uint8_t> sort_scratch;      // of CUB, where it needs little
  Buffer<SplatGradientSum> splat_gradients;  // (N)  zero between steps
  Buffer<FineSums> fine_sums;             // (N)  zero between steps, if deterministic
  Buffer<CoarseSums> coarse_sums;         // (N)  zero between steps, if deterministic
  // For scores that sum over fragments; empty without one, and where they are among the gradients
  Buffer<Vec4f> fragment_sums;            // (N)  count, first, second; zero between steps
  Buffer<FixedFragmentSums> fixed_fragment_sums;  // (N)  the same if deterministic, and of a score pass
  // Of steps with surface terms: dL/d(surface_rows), and what they make of the parameters.
  Buffer<SurfaceRow> surface_gradients;           // (N)
  Buffer<GaussianShape<float>> shape_gradients;   // (N)
  Buffer<float> pixel_values;             // (H, W)  of a score pass
  Buffer<std::uint32_t> value_range;      // (2)  bits of the lowest and the highest value
  Buffer<std::uint8_t> drawn_tiles;       // (tiles)  0: RenderSettings::mask leaves the tile out
  Buffer<std::uint32_t> halted;           // (1)  1: too many instances; no update until cleared

  explicit Workspace(Memory& memory)
      : depth_keys(memory), rows(memory), visible_count(memory), taken_depth_keys(memory),
        first_of_order(memory), instance_buffer(memory), length_classes(memory), sort_scratch(memory),
        splat_gradients(memory), fine_sums(memory), coarse_sums(memory), fragment_sums(memory),
        fixed_fragment_sums(memory), surface_gradients(memory), shape_gradients(memory),
        pixel_values(memory), value_range(memory), drawn_tiles(memory), halted(memory) {}
};
// clang-format on

/// A photo of a step as stages 1 and 7 see it, which work on rows of the model. Its arrays have the
/// rows of the whole model.
struct PhotoRows {
  Camera camera;
  RenderSettings settings;
  const DevicePose* pose;  // takes the place of the camera's; null: the camera is as it is given
  Splat* splats;           // (N)
  Rect* pixel_rects;       // (N)
  std::uint32_t* tile_counts;   // (N)
  std::uint32_t* depth_keys;    // (N)
  SplatGradientSum* gradients;  // (N)  zero once they are pulled back
  // of scores that sum over fragments, where these sums are not among the gradients
  Vec4f* fragment_sums;                    // (N)
  FixedFragmentSums* fixed_fragment_sums;  // (N)  if deterministic

  /// With the arrays of a pass and a workspace, which have their sizes.
  PhotoRows(const Camera& camera_, const RenderSettings& settings_, const DevicePose* pose_,
            const Workspace& workspace, const RenderPass& pass)
      : camera(camera_), settings(settings_), pose(pose_), splats(pass.splats.data()),
        pixel_rects(pass.pixel_rects.data()), tile_counts(pass.tile_counts.data()),
        depth_keys(workspace.depth_keys.data()), gradients(workspace.splat_gradients.data()),
        fragment_sums(workspace.fragment_sums.data()),
        fixed_fragment_sums(workspace.fixed_fragment_sums.data()) {}
  std::size_t pixel_count() const { return std::size_t(camera.width) * camera.height; }
};
/// Whether one of the photos was taken through a lens.
inline bool any_has_lens(Span<const PhotoRows> photos) {
  for (std::size_t p = 0; p < photos.size; ++p)
    if (photos[p].camera.has_lens()) return true;
  return false;
}

/// What a step changes a model by.
struct ModelUpdate {
  AdamSteps adam;
  AdamRule rule;
  MomentRounding rounding;
  DensityStep density;
};

/// The background of a picture as kernels get it.
struct Background {
  Vec3f color;
  const float* on_device;  // as in RenderSettings

  explicit Background(const RenderSettings& settings)
      : color(settings.background), on_device(settings.background_on_device) {}
#ifdef __CUDACC__
  __device__ Vec3f operator()() const {
    return on_device ? Vec3f(on_device[0], on_device[1], on_device[2]) : color;
  }
#endif
};

#ifdef __CUDACC__
/// dL/d(splat) of a visible Gaussian. Color gradients are zero where blending clamped the color.
__device__ inline SplatGradient masked(const SplatGradientSum& sum, const Vec3f& color) {
  return {sum.mean2d,
          {sum.conic_xx, sum.conic_xy, sum.conic_yy},
          sum.opacity,
          {color.x >= 0.0f ? sum.red : 0.0f, color.y >= 0.0f ? sum.green : 0.0f,
           color.z >= 0.0f ? sum.blue : 0.0f},
          sum.depth};
}
#endif

/// a + b, but at most 2^32 - 1: a count of instances that wrapped would look small enough to sort.
GS_HD std::uint32_t saturating_sum(std::uint32_t a, std::uint32_t b) {
  const std::uint32_t sum = a + b;
  return sum < a ? 0xffffffffu : sum;
}

/// True where blend() works on tensor cores. Truncation by standard deviations gives each splat a
/// lowest exponent of its own, which the products cannot test; in the order by pixel, pixels blend
/// different splats at a time.
inline bool blends_on_tensor_cores(const Context& context, const RenderSettings& settings) {
  return settings.use_tensor_cores && context.has_tensor_cores() &&
         settings.truncation == Truncation::alpha && settings.order == RenderOrder::z;
}

/// Calls f(splats) with the splats of a pass, of whichever type stage 1 has made.
template <class F>
void with_splats(const RenderPass& pass, F&& f) {
  const CudaScratch& scratch = pass.scratch<CudaScratch>();
  if (scratch.has_view_splats)
    f(scratch.view_splats.data());
  else
    f(pass.splats.data());
}

/// The edge of the tiles of a frame of so many Gaussians that is drawn from a packed model. Wide
/// ones make fewer instances, which pays in large pictures.
int tile_edge_of(const Context& context, const RenderSettings& settings, const Camera& camera,
                 std::size_t gaussians);

/// Calls f(edge of the pass' tiles, splats), the edge as a constant. Tiles are wide only where
/// splats have 32 bytes.
template <class F>
void with_tiles(const RenderPass& pass, F&& f) {
  with_splats(pass, [&](auto* splats) {
    if constexpr (std::is_same_v<decltype(splats), ViewSplat*>)
      if (pass.tile_edge == kWideTile) return f(std::integral_constant<int, kWideTile>(), splats);
    GS_CHECK(pass.tile_edge == kTileWidth);
    f(std::integral_constant<int, kTileWidth>(), splats);
  });
}

/// True where a pass is drawn in the order by pixel, and so by files of that name.
inline bool is_by_pixel(const RenderPass& pass) { return !pass.ray_depths.empty(); }

/// True where the tile numbers of a pass fit keys of 16 bits, with the number for "no tile".
inline bool uses_short_keys(const RenderPass& pass) {
  return pass.tile_count() < kShortKeyTiles && !is_by_pixel(pass);
}

/// 1  preprocess.cu: activate, cull, project, color; one splat per Gaussian, and which tiles it
/// hits.
void preprocess(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                const RenderSettings& settings, Workspace& workspace, RenderPass& pass);

/// After 1, in the order by pixel  pixel_order.cu: how far along the rays of the view the Gaussians of
/// a pass are. `pose` as in PhotoRows.
void find_ray_depths(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                     const DevicePose* pose, RenderPass& pass);

/// 1 for the photos of a step  preprocess.cu: the same into the arrays of each photo. Here and
/// below, `shard` says which rows of the model the Gaussians are.
void preprocess(Context& context, const GaussiansSpan& gaussians, Span<const PhotoRows> photos,
                const Shard& shard = {});

/// 2, 3  sort.cu: sort the Gaussians from near to far, the culled ones last, and find where each
/// one's instances begin. If at most `most_visible` of them are visible and that is less than half,
/// pass.depth_order has `most_visible` rows. If more are visible, the rows that it has are visible
/// ones, so that they have as many instances at least.
void order_by_depth(Context& context, const RenderSettings& settings, Workspace& workspace,
                    RenderPass& pass, std::size_t most_visible);

/// Throws Error where a pass has more Gaussians than the entries of lists can hold
/// (kMostGaussians).
void check_gaussian_count(const RenderPass& pass);

/// How many instances are written, and to whom it is told.
struct InstanceLimit {
  std::uint32_t capacity;           // places; those that are left belong to no tile
  std::uint32_t* halted = nullptr;  // raised where there are more instances; may be null
  StepReport* report = nullptr;     // in memory that host and device share; may be null
  std::uint32_t step = 0;           // the report's number
};

/// 2  instances.cu: write one instance for each tile hit, in that order.
void create_instances(Context& context, const RenderSettings& settings, Workspace& workspace,
                      RenderPass& pass, const InstanceLimit& limit);
/// After 1, 2  instances.cu: report only how many there are.
void report_instances(Context& context, const RenderSettings& settings, Workspace& workspace,
                      const RenderPass& pass, StepReport* report, std::uint32_t step);

/// After 2, in the order by pixel  pixel_order.cu: keys of the instances also hold their depths.
void add_depths_to_keys(Context& context, const RenderSettings& settings, Workspace& workspace,
                        RenderPass& pass, std::uint32_t capacity);

/// 3  sort.cu: order the instances by tile, stably, find each tile's list, and put the longest
/// first, unless there are so many tiles that their order does not matter. For the backward pass
/// the lists are also divided into segments.
void sort_by_tile(Context& context, const RenderSettings& settings, Workspace& workspace,
                  RenderPass& pass, std::uint32_t capacity);

/// 4  blend.cu: blend each tile's list front to back over the background.
void blend(Context& context, const RenderSettings& settings, RenderPass& pass);

/// 4  blend_pixel_order.cu: the same in the order by pixel. blend() has sized the images.
void blend_by_pixel(Context& context, const RenderSettings& settings, RenderPass& pass);

/// 4  blend_gemm.cu: the same on tensor cores, compute capability 8 and later. blend() has sized
/// the images.
void blend_gemm(Context& context, const RenderSettings& settings, RenderPass& pass);

/// After 4  picture.cu: the picture as 8 bits, clamped and rounded as to_image8 does; words hold
/// the bytes (H, W, 3) and up to 11 more.
void pack_picture(Context& context, const RenderPass& pass, Buffer<std::uint32_t>& words);

/// 6  blend_backward.cu: from dL/d(picture) to dL/d(splat), added to workspace.splat_gradients. In the
/// order by pixel with the kernel of gradients/pixel_order.cuh.
void blend_backward(Context& context, const RenderSettings& settings, const PictureGradient& dL,
                    Workspace& workspace, const RenderPass& pass);

/// True where the sums over fragments of the score "force" find room in
/// Workspace::splat_gradients, and stage 7 adds them to the statistics. Photos with a depth map have
/// sums of their own, so that there are fewer kernels; and so have surfaces, whose gradients by the
/// opacity are added to the same numbers.
inline bool sums_among_gradients(const RenderSettings& settings) {
  return StepSums{settings.fragment_statistic == FragmentStatistic::force, settings.deterministic,
                  settings.absolute_gradient, settings.blends_depth || settings.blends_surface}
      .forces_among_gradients();
}
/// From a photo's forces by the mean loss to those by its sum.
inline float force_scale(std::size_t pixels) { return 3.0f * float(pixels); }
/// After 4, in a score pass  pixel_values.cu: the values of the pixels, into
/// workspace.pixel_values. `photo` is null without a photometric model.
void find_pixel_values(Context& context, const PhotoBytes& bytes, const View& view,
                       const PhotoOnDevice* photo, const PixelRule& rule, Workspace& workspace,
                       const RenderPass& pass);
/// After that  blend_values.cu: adds their sums over the fragments of each Gaussian to `to`.
void blend_values(Context& context, const RenderSettings& settings, Workspace& workspace,
                  const RenderPass& pass, Span<FragmentSums> to);
/// After 6  fragment_sums.cu: adds the photo's sums over fragments to `to`, and clears them. Does
/// nothing where they are among the gradients. `to` stays as it is while `halted` is raised.
void gather_fragment_sums(Context& context, const PhotoRows& photo, Span<FragmentSums> to,
                          const std::uint32_t* halted, const Shard& shard = {});
/// fragment_sums.cu: to += from, and clears `from`, unless `halted`, which may be
/// null, is raised.
void add_fragment_sums(Context& context, Span<FragmentSums> to, Span<FragmentSums> from,
                       const std::uint32_t* halted);

/// After 4  operator/blend_features.cu: features of a picture whose colors have been blended for a
/// backward pass, (H, W, channels).
void blend_features(Context& context, const RenderSettings& settings, const RenderPass& pass,
                    const OperatorInput& input, float* to);
/// After 6  operator/blend_features.cu: adds to workspace.splat_gradients, and to the gradient by the
/// features (N, channels), where it is not null.
void blend_features_backward(Context& context, const RenderSettings& settings,
                             const RenderPass& pass, const OperatorInput& input,
                             const OperatorPictureGradient& dL, const std::uint32_t* overflowed,
                             Workspace& workspace, float* to);

/// After 4  gradients/surface.cu: finds the surfaces of visible Gaussians, and sums them over the
/// fragments of each pixel, into pass.surface_image.
void blend_surface(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                   const RenderSettings& settings, RenderPass& pass);
/// After 6  gradients/surface.cu: adds what dL/d(surface_image) makes of each splat to
/// workspace.splat_gradients, and pulls the rest back to workspace.shape_gradients, times `weight`:
/// to what is there or, for the first photo of a step, in its place. Nothing is defined while
/// `halted`, which may be null, is raised.
void surface_backward(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                      const RenderSettings& settings, Span<const SurfaceRow> dL, float weight,
                      bool is_first, const std::uint32_t* halted, Workspace& workspace,
                      const RenderPass& pass);

/// 7  preprocess_backward.cu: from dL/d(splat) to the gradients of the parameters, with
/// `shape_gradients` (N), which may be null, beside them. Clears photo.gradients.
void preprocess_backward(Context& context, const GaussiansSpan& gaussians, const PhotoRows& photo,
                         const GaussiansSpan& gradients, Span<Vec2f> dL_dmean2d,
                         const GaussianShape<float>* shape_gradients = nullptr);

/// Before 7, for runs that refine poses  camera_gradient.cu: the gradient by the camera, added up over
/// the Gaussians in an order that is always the same. First each GPU adds up blocks of its rows,
/// whose chunks have whole blocks.
///
/// of_blocks  (blocks of the whole model, 6)
void add_camera_blocks(Context& context, const GaussiansSpan& gaussians, const PhotoRows& photo,
                       double* of_blocks, const Shard& shard = {});
/// Then it adds up all blocks, and pulls the sum back to the motion of the photo's row:
/// row.gradient += weight * dL/d(motion). It is undefined while a step is halted.
void camera_gradient(Context& context, const double* of_blocks, std::size_t blocks,
                     const PoseRow& row, double weight);
/// The blocks of so many rows.
std::size_t camera_blocks(std::size_t rows);

/// 7 and 8 in one  preprocess_backward.cu, and update_by_photos.cu for several photos: pull the
/// gradients back and update the parameters by their mean at once, so that no gradient of a
/// parameter is stored. Gradients of the photos are cleared. Invisible rows are updated, too; SH
/// coefficients beyond the degree of the last photo stay. Nothing is updated while `halted` is
/// raised. add_position_noise() adds the noise that update.density asks for.
///
/// shape_gradients  (N)  of surface terms, added to the mean of the photos' gradients; may be null
void update_by_photos(Context& context, TrainingModel& model, Span<const PhotoRows> photos,
                      const ModelUpdate& update, const std::uint32_t* halted,
                      const Shard& shard = {},
                      const GaussianShape<float>* shape_gradients = nullptr);

/// An addition of the MCMC strategy to 8  langevin.cu: noise on the means after Adam. None is added
/// while `halted` is raised.
void add_position_noise(Context& context, const GaussiansSpan& gaussians,
                        const PositionNoise& noise, float position_rate,
                        const std::uint32_t* halted, const Shard& shard = {});

/// The other stages, behind the interfaces of gs_train.
std::unique_ptr<Loss> make_loss(Context& context, Memory& memory, PhotoStore& photos);  // 5 ssim.cu
/// fusion/fusion.cu: the surface of passes, as triangles are made of it.
std::unique_ptr<Fusion> make_fusion(Context& context, Memory& memory, const FusionRule& rule);
/// 5 ssim.cu for pictures of callers: writes the value, and the gradient by the picture where
/// dL_dimage is not null.
void compare_pictures(Context& context, Memory& scratch, const OperatorComparison& given,
                      float* value, float* dL_dimage);
/// 9 rows.cu, 10 morton.cu. Splats and rectangles are those of the training pass: row operations
/// use their memory. Before large arrays grow, `release_step` is called to release what else the
/// step has, so that the old rows of an array have room beside the new ones.
std::unique_ptr<RowOps> make_row_ops(Context& context, Memory& memory, Buffer<Splat>& splats,
                                     Buffer<Rect>& pixel_rects, std::function<void()> release_step);

}  // namespace gs::cuda
