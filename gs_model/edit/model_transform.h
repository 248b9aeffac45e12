// SPDX-License-Identifier: Apache-2.0
// Changes to whole models on their way into a file: turned, moved and scaled, with their SH
// coefficients, or cut to a lower SH degree.
#pragma once

#include "gs_core/camera.h"
#include "gs_core/gaussians.h"
#include "gs_core/geometry/similarity.h"

namespace gs {

/// x -> scale * R (x - center)
struct ModelTransform {
  Vec3d center{0.0, 0.0, 0.0};    // of the model, goes to the origin   world units
  Quat<double> turn{1, 0, 0, 0};  // R, of length 1
  double scale = 1;               // > 0

  bool turns_or_scales() const { return turn.w != 1 || scale != 1; }
  bool is_identity() const { return !turns_or_scales() && center == Vec3d(0.0); }
};

/// The shortest turn that takes the direction `up` to -y, which viewers show at the top. `up` is in
/// the PLY's axes and not 0.
Quat<double> turn_upright(const Vec3d& up);

/// The median of the finite means, axis by axis; 0 where there are none.
Vec3d median_mean(const GaussianModel& model);

/// Applies the transform to every Gaussian. After a mere shift, mean + world_offset is what it was
/// before; after a turn or a scaling the world offset is 0. Throws UsageError where Gaussians in
/// space and time would be scaled.
void transform_model(GaussianModel& model, const ModelTransform& transform);

/// The camera that sees a transformed model as `camera` sees the model:
///   R' = R_c R^T,  t' = s (R_c c + t_c)     for x' = s R (x - c)
Camera moved(Camera camera, const ModelTransform& transform);

/// Sets the SH degree to `degree` if that is lower, and the coefficients beyond it to 0.
void limit_sh_degree(GaussianModel& model, int degree);
/// A copy with that limit.
GaussianModel copy_with_degree(const GaussianModel& model, int degree);

/// The transform x -> similarity(x + offset).
ModelTransform transform_of(const Similarity& similarity, const Vec3d& offset);

/// The transform that undoes another.
ModelTransform inverse_of(const ModelTransform& transform);

/// Transforms as matrices for columns (x y z 1), by rows.
struct Mat4d {
  double m[4][4];

  bool operator==(const Mat4d&) const = default;
};
Mat4d matrix_of(const ModelTransform& transform);
/// The opposite, for a matrix that turns, scales evenly and moves.
ModelTransform transform_of(const Mat4d& similarity);
Mat4d matrix_of(const Similarity& similarity);
Mat4d multiply(const Mat4d& a, const Mat4d& b);
Mat4d diagonal(const Vec3f& signs);
Mat4d translation(const Vec3d& by);
/// Whether the matrix turns, scales evenly and moves, and mirrors nothing.
bool is_similarity(const Mat4d& matrix);
/// The inverse of a matrix that turns, mirrors, scales evenly and moves.
Mat4d inverse_of(const Mat4d& similarity);

}  // namespace gs
