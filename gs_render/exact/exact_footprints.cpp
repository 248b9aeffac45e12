// SPDX-License-Identifier: Apache-2.0
// What callers of exact_renderer.h may know of each Gaussian in a view: as pictures have it, and by
// the rules of other rasterizers.
#include "gs_render/exact/exact_renderer.h"

namespace gs {
namespace {

/// The inverse of a conic: the image-plane covariance, pixels^2.
Sym2<double> inverse(const Sym2<double>& conic) {
  const double det = conic.xx * conic.yy - conic.xy * conic.xy;
  return {conic.yy / det, -conic.xy / det, conic.xx / det};
}

/// Whether the stages of tiles would list the splat.
bool meets_a_tile(const BasicSplat<double>& splat, const Sym2<double>& cov2d,
                  const PinholeCamera<double>& camera) {
  const Vec2f mean2d(splat.mean2d);
  const Sym2<float> conic{float(splat.conic.xx), float(splat.conic.xy), float(splat.conic.yy)};
  const Rect pixels = pixel_rect(mean2d, {float(cov2d.xx), float(cov2d.xy), float(cov2d.yy)},
                                 float(splat.cutoff), (camera.width + kTileWidth - 1) / kTileWidth,
                                 (camera.height + kTileHeight - 1) / kTileHeight);
  bool meets = false;
  if (!pixels.empty())
    for_each_hit_tile(mean2d, conic, float(splat.cutoff), pixels, [&](int, int) { meets = true; });
  return meets;
}

int radius_of(const Sym2<double>& cov2d, double cutoff) {
  const double mid = 0.5 * (cov2d.xx + cov2d.yy), half = 0.5 * (cov2d.xx - cov2d.yy);
  const double largest = mid + std::sqrt(half * half + cov2d.xy * cov2d.xy);  // eigenvalue
  return std::max(1, int(std::ceil(std::min(std::sqrt(2 * cutoff * largest), 1e9))));
}

}  // namespace

ExactFootprints exact_footprints(const ExactGaussians<double>& gaussians,
                                 const ExactView<double>& view, const ExactSettings& settings) {
  check_sizes(gaussians, view);
  const std::size_t n = gaussians.count();
  ExactFootprints footprints{std::vector<Vec2<double>>(n, {0, 0}), std::vector<double>(n, 0),
                             std::vector<Sym2<double>>(n, {0, 0, 0}), std::vector<int>(n, 0)};
  for (const ExactSplat<double>& at : exact_splats(gaussians, view, settings)) {
    const Sym2<double> cov2d = inverse(at.splat.conic);
    if (!settings.is_smooth && !meets_a_tile(at.splat, cov2d, view.camera)) continue;
    footprints.means2d[at.row] = at.splat.mean2d;
    footprints.depths[at.row] = at.depth;
    footprints.conics[at.row] = at.splat.conic;
    footprints.radii[at.row] = radius_of(cov2d, at.splat.cutoff);
  }
  return footprints;
}

std::vector<Footprint<double>> footprints_by_rule(const ExactGaussians<double>& gaussians,
                                                  const ExactView<double>& view,
                                                  const SplatSettings& settings,
                                                  const FootprintRule& rule) {
  check_sizes(gaussians, view);
  std::vector<Footprint<double>> footprints(gaussians.count());
  for (std::size_t i = 0; i < footprints.size(); ++i) {
    if (gaussians.covariances.empty() && is_degenerate(gaussians.rotations[i])) continue;
    footprints[i] =
        footprint(view.camera, to_camera(view.camera, gaussians.means[i]),
                  exact_covariance(gaussians, i), gaussians.opacities[i], settings, rule);
  }
  return footprints;
}

}  // namespace gs
