// SPDX-License-Identifier: Apache-2.0
// The CUDA stages in pipeline order: the table of contents, as gs_render/stages.h and gs_train/scalar_stages.h
// are the scalar ones'. Each only launches; none waits, none allocates once its buffers have grown.
#pragma once

#include <memory>

#include "cuda/context.cuh"
#include "cuda/fixed_sums.cuh"
#include "cuda/photos.cuh"
#include "gs_core/math/adam.h"
#include "gs_train/backend.h"

namespace gs::cuda {

/// What the device tells the host of one step: written by create_instances(), read when somebody asks.
struct StepReport {
  std::uint32_t instances;  // that the view has
  std::uint32_t halted;     // 1: this step or one before it had more instances than room
  std::uint32_t unused;
  std::uint32_t step;       // number of the step, written last
};

/// A piece of a tile's list.
struct ListSegment {
  std::uint32_t tile;    // kNoTile: none
  std::uint32_t number;  // within the list: 0, 1, ...
};
inline constexpr std::uint32_t kNoTile = 0xffffffffu;

/// What stage 3 and 4 leave with a RenderPass for blending: which tiles come first, and the lists in segments that the
/// backward pass can walk independently.
struct CudaScratch final : BackendScratch {
  Buffer<std::uint32_t> tile_order;         // (tiles) those with the longest lists first
  Buffer<std::uint32_t> first_checkpoints;  // (tiles) where a tile's checkpoints begin; one per segment but the first
  Buffer<ListSegment> segments;             // (capacity S) the longest first, then empty ones
  Buffer<Vec4f> checkpoints;                // (S - tiles, pixels of a tile) color and transmittance before a segment

  explicit CudaScratch(Memory& memory)
      : tile_order(memory), first_checkpoints(memory), segments(memory), checkpoints(memory) {}
};

/// What one render needs besides the RenderPass: working room of the sorts, and what only the GPU's stages hand
/// to each other.
struct WorkingRoom {
  Buffer<std::uint32_t> depth_keys, sorted_depth_keys;  // (N)  culled ones behind all others
  Buffer<std::uint32_t> row_numbers;      // (N)   0, 1, 2, ...
  Buffer<std::uint32_t> first_of_order;   // (N)   first instance of each Gaussian in depth order
  Buffer<std::uint32_t> keys, sorted_keys;  // (room for instances) their tiles, in 16 or 32 bits
  Buffer<std::uint32_t> instance_splats;  // (room for instances) their Gaussians, in depth order
  Buffer<std::uint8_t> sort_room;         // CUB's
  Buffer<SplatGradientSum> splat_gradients;  // (N)  zero between steps
  Buffer<FineSums> fine_sums;             // (N)  zero between steps; of deterministic steps only, as the next
  Buffer<CoarseSums> coarse_sums;         // (N)  zero between steps
  Buffer<std::uint32_t> halted;           // (1)   1: a view had more instances than room; nothing is updated until cleared

  explicit WorkingRoom(Memory& memory)
      : depth_keys(memory), sorted_depth_keys(memory), row_numbers(memory), first_of_order(memory),
        keys(memory), sorted_keys(memory), instance_splats(memory), sort_room(memory),
        splat_gradients(memory), fine_sums(memory), coarse_sums(memory), halted(memory) {}
};

/// Instances of a list that one warp walks back; a checkpoint of each pixel lies between two segments.
inline constexpr std::uint32_t kSegmentLength = 512;

/// True where the tiles of a pass, and the number that stands for no tile, fit keys of 16 bits.
inline bool uses_short_keys(const RenderPass& pass) { return pass.tile_count() < 65536; }

/// 1  preprocess.cu: activate, cull, project, color; one splat per Gaussian, and which tiles it hits.
void preprocess(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                const RenderSettings& settings, WorkingRoom& room, RenderPass& pass);

/// 2, 3  sort.cu: all Gaussians near to far, the culled ones last; and where each one's instances begin.
void order_by_depth(Context& context, WorkingRoom& room, RenderPass& pass);

/// 2  instances.cu: one instance for each tile hit, in that order; the places up to `capacity` that are left are
/// given to no tile. More instances than that raise room.halted. `report` may be null, or lies in memory that
/// both sides see.
void create_instances(Context& context, const RenderSettings& settings, WorkingRoom& room,
                      RenderPass& pass, std::uint32_t capacity, StepReport* report,
                      std::uint32_t step);

/// 3  sort.cu: order the instances by tile, stably, find each tile's list, and put the longest first.
void sort_by_tile(Context& context, WorkingRoom& room, RenderPass& pass, std::uint32_t capacity);

/// 4  blend.cu: blend each tile's list front to back over the background.
void blend(Context& context, const RenderSettings& settings, RenderPass& pass);

/// 4  blend_gemm.cu: the same on tensor cores; the images are sized already. Compute capability 8 and later.
void blend_gemm(Context& context, const RenderSettings& settings, RenderPass& pass);

/// 6  blend_backward.cu: from dL/d(image), (3, H, W), to dL/d(splat), added to room.splat_gradients.
void blend_backward(Context& context, const RenderSettings& settings, Span<const float> dL_dimage,
                    WorkingRoom& room, RenderPass& pass);

/// 7  preprocess_backward.cu: from dL/d(splat) to the gradients of the parameters. Clears room.splat_gradients.
void preprocess_backward(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                         const RenderSettings& settings, WorkingRoom& room, RenderPass& pass,
                         const GaussiansSpan& gradients, Span<Vec2f> dL_dmean2d);

/// The Adam step of each learned quantity.
template <class T>
using AdamStepOf = AdamStep;
using AdamSteps = GaussianArrays<AdamStepOf>;
AdamSteps adam_steps(int t, const LearningRates& rates);

/// 7 and 8 in one  preprocess_backward.cu: pulls the gradients back and updates the parameters at once, so that
/// no gradient of a parameter is ever stored. Rows that are not visible are updated, too. While room.halted is
/// raised, nothing is updated. Of `density` the noise is left to add_position_noise().
void preprocess_backward_and_update(Context& context, TrainingModel& model, const Camera& camera,
                                    const RenderSettings& settings, const AdamSteps& steps,
                                    const DensityStep& density, WorkingRoom& room,
                                    RenderPass& pass);

/// What the MCMC strategy adds to 8  langevin.cu: the regularizers' gradients before Adam, where gradients are stored;
/// and noise on the means after it, unless `halted` is raised (or null).
void add_regularizer_gradients(Context& context, const GaussiansSpan& gaussians,
                               const Regularizers& regularizers, const GaussiansSpan& gradients);
void add_position_noise(Context& context, const GaussiansSpan& gaussians,
                        const PositionNoise& noise, float position_rate,
                        const std::uint32_t* halted);

/// The other stages, behind the contracts of gs_train.
std::unique_ptr<Loss> make_loss(Context& context, Memory& memory, PhotoStore& photos);  // 5 ssim.cu
std::unique_ptr<Optimizer> make_optimizer(Context& context);                            // 8 adam.cu
std::unique_ptr<RowOps> make_row_ops(Context& context, Memory& memory);                 // 9 rows.cu, 10 morton.cu

}  // namespace gs::cuda
