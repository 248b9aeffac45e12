// SPDX-License-Identifier: Apache-2.0
// Several Gaussians become one by matching moments, and what such a merge changes in a picture.
// decimate.h merges the cheapest pairs of a model; levels of detail merge groups.
#pragma once

#include "gs_core/gaussians.h"

namespace gs {

/// What a merge looks at: shape, opacity and color, without the SH beyond degree 0. 68 bytes.
struct MergeShape {
  Vec3f mean;         // world units
  Sym3<float> sigma;  // covariance, world units^2
  float opacity;      // 0..1
  float area;         // surface of the ellipsoid of one standard deviation, world units^2
  Vec3f color;        // of degree 0, 0.5 + C0 sh0
  float importance;   // how much pictures show of it for its mass, up to a factor; 1: not known

  float mass() const { return opacity * area; }  // the weight of this Gaussian in a merge
};

/// The surface of an ellipsoid with these half axes, to 1.1 %:
///
///   A = 4 pi (((ab)^p + (ac)^p + (bc)^p) / 3)^(1/p),  p = 1.6075        Thomsen 2004
///
/// Each of `squares` is the square of a half axis, world units^2; slightly negative ones count as
/// 0.
double ellipsoid_area(const Vec3d& squares);

/// The shape of row i.   Host memory, Gaussians without time.
MergeShape merge_shape_of(const Gaussians& gaussians, std::size_t i, float importance = 1);

/// The shape of two merged Gaussians, which has the mean and the covariance of their mixture:
///
///   w_i = m_i / sum m,  m_i = opacity_i A_i                    (half each where both are 0)
///   mu = sum w_i mu_i,  Sigma = sum w_i (Sigma_i + (mu_i - mu)(mu_i - mu)^T)
///   opacity = min(1, sum m_i / A(Sigma)),  importance = sum w_i importance_i
///   color = sum v_i color_i,  v_i = m_i importance_i / sum m importance: as pictures show it
MergeShape merged_shape(const MergeShape& a, const MergeShape& b);

/// How much a picture changes if two Gaussians are merged. A splat is taken as opacity times a 2D
/// Gaussian, as it is blended where nothing is in front of it. Its squared difference to the two
/// that it replaces is integrated over the plane, in closed form, and averaged over views along
/// the three axes:
///
///   cost = max(importance_a, importance_b) / 3 sum over x, y, z of
///          integral |o_a c_a G_a + o_b c_b G_b - o_m c_m G_m|^2,   c = (red, green, blue, 1)
///
///   integral G_a G_b = 2 pi sqrt(|S_a| |S_b| / |S_a + S_b|) exp(-d^T (S_a + S_b)^-1 d / 2)
///
/// with the 2x2 covariances S of each view. The 1 in c counts what is covered, so that black ones
/// are not merged for free. The larger importance counts: a hidden Gaussian must not take the place
/// of a visible one.
///
/// Returns world units^2, at least 0. Never throws.
double merge_cost(const MergeShape& a, const MergeShape& b);

/// Merges `count` rows of `from` into row `to_row` of `to`: the moments of merged_shape(), for any
/// number, and every SH coefficient sum v_i c_i. `importance` has one value for each of the rows;
/// null: 1. `to` may be `from`. Opacities stay below 0.9999,
/// so that logits are finite. Host memory; Gaussians without time and without a 3D filter
/// (bake_filter.h), with finite values and rotations of any length above 0; `count` is at least 1.
void merge_gaussians(const Gaussians& from, const std::uint32_t* rows, std::size_t count,
                     const Gaussians& to, std::size_t to_row, const float* importance = nullptr);

}  // namespace gs
