// SPDX-License-Identifier: Apache-2.0
// The scalar training stages, one file each. The scalar backend combines them.
#pragma once

#include <memory>
#include <vector>

#include "gs_core/math/density/pixel_rule.h"
#include "gs_train/loss.h"
#include "gs_train/row_ops.h"
#include "gs_train/training_model.h"
#include "gs_train/update.h"

namespace gs {

std::unique_ptr<Loss> make_l1_ssim_loss();  // 5  ssim.cpp
/// dL/d(depth) and dL/d(alpha), (H, W).
struct DepthGradient {
  Buffer<float> depth, alpha;
};
/// 5  depth_loss.cpp: compares the depth_image and the alpha of a pass with the view's depth map,
/// writes the gradient, and returns the loss, times `weight`. The gradient is 0 where the map teaches
/// nothing.
double compare_depth(const View& view, float weight, const RenderPass& pass, DepthGradient& dL);
/// dL/d(surface_image), (H, W), and what it is made of.
struct SurfaceGradient {
  Buffer<SurfaceRow> sums;
  std::vector<PixelSurface<float>> surfaces;
  std::vector<float> inverse_depth, gray, other_gray;
};
/// 5  surface_loss.cpp: compares the surface_image of a pass with itself, with the view's normals if
/// it has some and, by the photo, with a neighbor, which may be null. Both views are reduced as the pass is. Writes the gradient, and
/// returns the loss.
double compare_surface(const View& view, const View* neighbor, const SurfaceWeights& weights,
                       int patch_phase, const RenderPass& pass, SurfaceGradient& dL);
/// In a score pass  pixel_values.cpp: the values of the pixels of a rendered view, (H, W).
/// `appearance` may be null.
void find_pixel_values(const View& view, const PixelRule& rule, const RenderPass& pass,
                       const Appearance* appearance, Buffer<float>& values);

std::unique_ptr<RowOps> make_scalar_row_ops();  // 9  rows.cpp, 10 morton.cpp

/// 8  adam.cpp: one update of every row, visible or not (dense semantics). Adds update.rule.steps
/// to model.adam_steps.
void update_by_adam(TrainingModel& model, const Gaussians& gradients, const Update& update);
/// 8  langevin.cpp, what the MCMC strategy adds: gradients += those of the regularizers, for every
/// row, and after the update means += noise.
///
/// position_rate   the learning rate of the means in this step
void regularize(const TrainingModel& model, const Regularizers& regularizers, Gaussians& gradients);
void add_noise(TrainingModel& model, const PositionNoise& noise, float position_rate);

/// Statistics of a step  statistics.cpp: adds a photo's visibility and image-plane gradients, and
/// its sums over fragments, if there are any.
///
/// dL_dmean2d   (N)   pixels^-1
void gather_statistics(const RenderPass& pass, Span<const Vec2f> dL_dmean2d,
                       DensityStatistics& statistics);
void add_statistics(const DensityStatistics& from, DensityStatistics& to);
/// to += weight * from.
void add_weighted(const Gaussians& from, float weight, Gaussians& to);
/// The sums over fragments of the last backward pass, or of blend_values().
void add_fragment_sums(const RenderPass& pass, Span<FragmentSums> to);

/// relocate.cpp, behind RowOps::relocate() and replace().
RefineReport relocate(TrainingModel& model, const RelocationRules& rules, std::uint64_t seed,
                      int step);
void replace(TrainingModel& model, Span<const std::uint32_t> dead, Span<const std::uint32_t> source,
             float least_opacity);

/// grow.cpp, behind RowOps::grow() and apply().
RefineReport grow(TrainingModel& model, const GrowthRules& rules, std::uint64_t seed, int step);
RefineReport apply(TrainingModel& model, Span<const GrowthAction> action, const GrowthRules& rules,
                   std::uint64_t seed, int step);

/// filter_3d.cpp, behind RowOps::measure_filter().
void measure_filter(TrainingModel& model, const std::vector<Camera>& cameras, float near_plane);

/// After a refinement: the moments of the rows from `first` on, which are new, and the statistics of
/// those from `first_statistic` on become zero.
void start_new_rows(const Columns& columns, std::size_t first, std::size_t first_statistic = 0);

/// Puts rows into a new order, or keeps some of them: row i becomes what row source[i] was, in
/// every column.
void gather_rows(const Columns& columns, Span<const std::uint32_t> source);

/// Row numbers along the Morton curve of the means in their bounding cube. Rows of equal codes keep
/// their order. Rows in space and time are ordered by their bin of time first; both other arrays
/// are empty where rows have no time.
Buffer<std::uint32_t> morton_order(Span<const Vec3f> means, Span<const float> time_means,
                                   Span<const float> log_time_scales = {});

}  // namespace gs
