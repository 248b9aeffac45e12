// SPDX-License-Identifier: Apache-2.0
// The exact renderer: each Gaussian at each pixel in depth order, without tiles, in any scalar. In
// double its gradient is what finite differences and other frameworks' gradient checks compare
// with, and what callers without a GPU differentiate. It takes O(visible Gaussians) for a pixel.
// dual.h is the scalar that differentiates forward.
#pragma once

#include <vector>

#include "gs_core/math/pose/camera_entries.h"
#include "gs_core/math/render/blend.h"
#include "gs_render/footprint.h"

namespace gs {

/// What is drawn. Of each pair that is named with "or" one is empty.
template <class T>
struct ExactGaussians {
  std::vector<Vec3<T>> means;        // (N)  world units
  std::vector<Quat<T>> rotations;    // (N)  any length, with log_scales; or covariances
  std::vector<Vec3<T>> log_scales;   // (N)  log of standard deviations in world units
  std::vector<Sym3<T>> covariances;  // (N)  world units^2
  std::vector<T> opacities;          // (N)  0 to 1
  std::vector<Vec3<T>> colors;       // (N)  used as they are; or sh
  std::vector<Vec3<T>> sh;           // (N, sh_count())  coefficients, the color is at least 0
  std::vector<T> features;           // (N, channels)  blended as they are; may be empty
  int sh_degree = 0;                 // of sh, 0 to 3
  int channels = 0;

  std::size_t count() const { return means.size(); }
  std::size_t sh_count() const { return std::size_t((sh_degree + 1) * (sh_degree + 1)); }
};

/// Where it is seen from.
template <class T>
struct ExactView {
  PinholeCamera<T> camera;
  Vec3<T> background{T(0), T(0), T(0)};
  std::vector<Vec2<T>> screen{};  // (N)  added to the projected means, pixels; may be empty
};

struct ExactSettings {
  SplatSettings splat;  // its sh_degree does not count
  BlendRule rule = BlendRule::faster_gs;
  /// No fragment is dropped for its alpha, no alpha is clamped and no pixel ends, so that the
  /// picture is a smooth function of nearly all of its inputs.
  bool is_smooth = false;

  /// Whether alpha is clamped and pixels end by the classic rule.
  bool is_classic() const { return rule == BlendRule::classic && !is_smooth; }
};

/// A picture of H x W pixels. As dL/d(picture), an empty array counts as zeros.
template <class T>
struct ExactPicture {
  std::vector<Vec3<T>> image;    // (H, W)  with the background
  std::vector<T> alpha;          // (H, W)  1 - T
  std::vector<T> depth;          // (H, W)  sum of weights times depth along the viewing axis
  std::vector<T> inverse_depth;  // (H, W)  sum of weights over depth
  std::vector<T> features;       // (H, W, channels)
};

/// dL by each input, in arrays of the same shapes; `screen` also where it was empty.
struct ExactGradients : ExactGaussians<double> {
  std::vector<Vec2<double>> screen;  // (N)
  // (N)  sums over the pixels of the absolute values of their shares in `screen` (Ye et al. 2024)
  std::vector<Vec2<double>> absolute_screen;
  CameraEntriesGradient<double> camera;
  Vec3d background{0.0, 0.0, 0.0};
};

/// The visible Gaussians of a view, near to far, equal depths by row.
template <class T>
struct ExactSplat {
  std::uint32_t row;
  T depth;
  BasicSplat<T> splat;  // its color as it is blended
};
template <class T>
std::vector<ExactSplat<T>> exact_splats(const ExactGaussians<T>& gaussians,
                                        const ExactView<T>& view, const ExactSettings& settings);

/// The picture. Throws UsageError where arrays disagree about their sizes.
template <class T>
ExactPicture<T> exact_picture(const ExactGaussians<T>& gaussians, const ExactView<T>& view,
                              const ExactSettings& settings);

/// Where the Gaussians are in a picture; zeros where one is not visible.
struct ExactFootprints {
  std::vector<Vec2<double>> means2d;  // (N)  pixels
  std::vector<double> depths;         // (N)  along the viewing axis, world units
  std::vector<Sym2<double>> conics;   // (N)  1 / pixels^2
  std::vector<int> radii;             // (N)  half the ellipse's longer axis, pixels, at least 1
};
/// The ellipses are those outside of which no fragment is kept. A Gaussian is visible where its
/// ellipse meets a tile of the picture. In smooth pictures the ellipses are those of four standard
/// deviations, and all Gaussians that can be projected are visible.
ExactFootprints exact_footprints(const ExactGaussians<double>& gaussians,
                                 const ExactView<double>& view, const ExactSettings& settings);

/// The same by the rules of another rasterizer, one row for each Gaussian. Colors do not count.
std::vector<Footprint<double>> footprints_by_rule(const ExactGaussians<double>& gaussians,
                                                  const ExactView<double>& view,
                                                  const SplatSettings& settings,
                                                  const FootprintRule& rule);

/// The gradient of a scalar L by everything that exact_picture() reads, from dL/d(picture).
/// Gaussians that are not visible have none. Off-diagonal entries of covariances hold the derivative
/// by the stored number. Throws UsageError as exact_picture() does.
ExactGradients exact_gradients(const ExactGaussians<double>& gaussians,
                               const ExactView<double>& view, const ExactSettings& settings,
                               const ExactPicture<double>& dL_dpicture);

}  // namespace gs

#include "gs_render/exact/exact_picture.h"
