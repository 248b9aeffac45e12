// SPDX-License-Identifier: Apache-2.0
// The scalar training stages, one file each. The scalar backend combines them.
#pragma once

#include <memory>

#include "gs_train/backend.h"

namespace gs {

std::unique_ptr<Loss> make_l1_ssim_loss();  // 5  ssim.cpp
/// 5  depth_loss.cpp: compares the planes of blend_depth() with the view's depth map, writes
/// dL/d(planes), (3, H, W), and returns the loss, times `weight`. The gradient is 0 where the map
/// teaches nothing.
double compare_depth(const View& view, float weight, const Buffer<float>& planes,
                     Buffer<float>& dL_dplanes);
/// In a score pass  pixel_values.cpp: the values of the pixels of a rendered view, (H, W).
/// `appearance` may be null.
void find_pixel_values(const View& view, const PixelRule& rule, const RenderPass& pass,
                       const Appearance* appearance, Buffer<float>& values);

std::unique_ptr<Optimizer> make_scalar_optimizer();  // 8  adam.cpp
std::unique_ptr<RowOps> make_scalar_row_ops();       // 9  rows.cpp, 10 morton.cpp

/// 8  photometric.cpp: one update of all photos, in host memory. `gradient` is that of
/// the data, in the order of the state; the model's penalties are added to it.
void update_photometric(PhotometricState& state, const PhotometricModel& model, float rate,
                        const AdamRule& rule, std::vector<double>& gradient);

/// The losses of the scalar backend: the words of loss.kind.
std::vector<std::string> scalar_losses();

/// langevin.cpp, behind Optimizer: what the MCMC strategy adds to stage 8. The weights are those of
/// one Gaussian: Regularizers::of_each().
void add_regularizer_gradients(const GaussiansSpan& gaussians, const Regularizers& of_each,
                               const GaussiansSpan& gradients);
void add_position_noise(const GaussiansSpan& gaussians, const PositionNoise& noise,
                        float position_rate);

/// relocate.cpp, behind RowOps::relocate().
RefineReport relocate(TrainingModel& model, const RelocationRules& rules, std::uint64_t seed,
                      int step);

/// grow.cpp, behind RowOps::grow().
RefineReport grow(TrainingModel& model, const GrowthRules& rules, std::uint64_t seed, int step);

/// filter_3d.cpp, behind RowOps::measure_filter().
void measure_filter(TrainingModel& model, const std::vector<Camera>& cameras, float near_plane);

/// After a refinement: the moments of the rows from `first` on, which are new, and all statistics
/// become zero.
void start_new_rows(const Columns& columns, std::size_t first);

/// Puts rows into a new order, or keeps some of them: row i becomes what row source[i] was, in every
/// column.
void gather_rows(const Columns& columns, Span<const std::uint32_t> source);

/// Row numbers along the Morton curve of the means in their bounding cube. Rows of equal codes keep
/// their order. Rows in space and time are ordered by their bin of time first; both other arrays
/// are empty where rows have no time.
Buffer<std::uint32_t> morton_order(Span<const Vec3f> means, Span<const float> time_means,
                                   Span<const float> log_time_scales = {});

}  // namespace gs
