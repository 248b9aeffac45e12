// SPDX-License-Identifier: Apache-2.0
// The forward pass of exact_renderer.h, in any scalar.
#pragma once

#include <algorithm>
#include <string>

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/exact/exact_renderer.h"

namespace gs {

/// Throws UsageError where arrays disagree about their sizes.
template <class T>
void check_sizes(const ExactGaussians<T>& gaussians, const ExactView<T>& view) {
  const auto expect = [](const char* name, std::size_t size, std::size_t expected) {
    if (size != expected)
      throw UsageError(std::string(name) + " has " + std::to_string(size) +
                       " numbers or rows, but " + std::to_string(expected) + " are needed");
  };
  const std::size_t n = gaussians.count();
  if (gaussians.covariances.empty()) {
    expect("rotations", gaussians.rotations.size(), n);
    expect("log_scales", gaussians.log_scales.size(), n);
  } else {
    expect("covariances", gaussians.covariances.size(), n);
    expect("rotations beside covariances", gaussians.rotations.size(), 0);
    expect("log_scales beside covariances", gaussians.log_scales.size(), 0);
  }
  expect("opacities", gaussians.opacities.size(), n);
  if (gaussians.sh.empty()) {
    expect("colors", gaussians.colors.size(), n);
  } else {
    if (gaussians.sh_degree < 0 || gaussians.sh_degree > 3)
      throw UsageError("sh has a degree from 0 to 3, and not " +
                       std::to_string(gaussians.sh_degree));
    expect("sh", gaussians.sh.size(), n * gaussians.sh_count());
    expect("colors beside sh", gaussians.colors.size(), 0);
  }
  expect("features", gaussians.features.size(), n * std::size_t(gaussians.channels));
  if (!view.screen.empty()) expect("screen", view.screen.size(), n);
}

/// The world covariance of a row, which is not degenerate.
template <class T>
Sym3<T> exact_covariance(const ExactGaussians<T>& gaussians, std::size_t i) {
  if (!gaussians.covariances.empty()) return gaussians.covariances[i];
  return covariance(rotation_matrix(gaussians.rotations[i]), variance(gaussians.log_scales[i]));
}

/// The settings with which a splat's extent does not depend on its opacity, where that is wanted.
inline SplatSettings splat_settings_of(const ExactSettings& settings) {
  SplatSettings splat = settings.splat;
  if (settings.is_smooth) splat.truncation = Truncation::sigma4;  // a cutoff that nobody reads
  return splat;
}

template <class T>
std::vector<ExactSplat<T>> exact_splats(const ExactGaussians<T>& gaussians,
                                        const ExactView<T>& view, const ExactSettings& settings) {
  const SplatSettings splat_settings = splat_settings_of(settings);
  std::vector<ExactSplat<T>> splats;
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    const Vec3<T>& mean = gaussians.means[i];
    const Vec3<T> p = to_camera(view.camera, mean);
    if (!is_between_planes(depth_of(view.camera, p), splat_settings)) continue;
    if (gaussians.covariances.empty() && is_degenerate(gaussians.rotations[i])) continue;
    ProjectedGaussian<T> projected = project_ellipsoid(
        view.camera, p, exact_covariance(gaussians, i), gaussians.opacities[i], splat_settings);
    if (!projected.is_visible) continue;
    if (!view.screen.empty()) {
      projected.splat.mean2d += view.screen[i];
      if (!is_finite(Vec3<T>(projected.splat.mean2d, T(0)))) continue;
    }
    Vec3<T>& color = projected.splat.color;
    if (gaussians.sh.empty()) {
      color = gaussians.colors[i];
    } else {
      const Vec3<T>* const sh = &gaussians.sh[i * gaussians.sh_count()];
      color = sh_color(gaussians.sh_degree, unit_direction(view.camera.position(), mean), sh[0],
                       sh + 1);
      color = {max_of(color.x, T(0)), max_of(color.y, T(0)), max_of(color.z, T(0))};
    }
    if (is_finite(color)) splats.push_back({std::uint32_t(i), projected.depth, projected.splat});
  }
  std::stable_sort(splats.begin(), splats.end(),
                   [](const auto& a, const auto& b) { return a.depth < b.depth; });
  return splats;
}

/// One splat at one pixel.
template <class T>
struct ExactFragment {
  const ExactSplat<T>* splat;
  T dx, dy;    // the pixel's center minus the mean
  T gaussian;  // exp(exponent)
  T alpha;
  T transmittance;  // before it
};

/// The fragments of a pixel, front to back, into `fragments`. Returns the transmittance behind them.
template <class T>
T exact_fragments(const std::vector<ExactSplat<T>>& splats, const ExactSettings& settings, int x,
                  int y, std::vector<ExactFragment<T>>& fragments) {
  using std::exp;
  const bool is_classic = settings.is_classic();
  fragments.clear();
  T transmittance(1);
  for (const ExactSplat<T>& at : splats) {
    const BasicSplat<T>& splat = at.splat;
    const T dx = T(x + 0.5) - splat.mean2d.x, dy = T(y + 0.5) - splat.mean2d.y;
    const T exponent = fragment_exponent(splat.conic, dx, dy);
    if (!settings.is_smooth && exponent < -splat.cutoff) continue;
    const T gaussian = exp(exponent);
    const T alpha = is_classic ? fragment_alpha<BlendRule::classic>(splat.opacity, gaussian)
                               : fragment_alpha<BlendRule::faster_gs>(splat.opacity, gaussian);
    const T behind = transmittance * (T(1) - alpha);
    const bool ends = !settings.is_smooth && is_opaque(behind);
    if (ends && is_classic) break;
    fragments.push_back({&at, dx, dy, gaussian, alpha, transmittance});
    transmittance = behind;
    if (ends) break;
  }
  return transmittance;
}

template <class T>
ExactPicture<T> exact_picture(const ExactGaussians<T>& gaussians, const ExactView<T>& view,
                              const ExactSettings& settings) {
  check_sizes(gaussians, view);
  const std::vector<ExactSplat<T>> splats = exact_splats(gaussians, view, settings);
  const std::size_t channels = std::size_t(gaussians.channels);
  const std::size_t width = std::size_t(view.camera.width);
  const std::size_t pixels = width * std::size_t(view.camera.height);
  ExactPicture<T> picture{std::vector<Vec3<T>>(pixels, Vec3<T>(T(0))), std::vector<T>(pixels, T(0)),
                          std::vector<T>(pixels, T(0)), std::vector<T>(pixels, T(0)),
                          std::vector<T>(pixels * channels, T(0))};
  parallel_chunks(pixels, 64, [&](std::size_t begin, std::size_t end) {
    std::vector<ExactFragment<T>> fragments;
    for (std::size_t pixel = begin; pixel < end; ++pixel) {
      const T transmittance =
          exact_fragments(splats, settings, int(pixel % width), int(pixel / width), fragments);
      for (const ExactFragment<T>& fragment : fragments) {
        const ExactSplat<T>& splat = *fragment.splat;
        const T weight = fragment.transmittance * fragment.alpha;
        picture.image[pixel] += weight * splat.splat.color;
        picture.depth[pixel] += weight * splat.depth;
        picture.inverse_depth[pixel] += weight / splat.depth;
        for (std::size_t c = 0; c < channels; ++c)
          picture.features[pixel * channels + c] +=
              weight * gaussians.features[splat.row * channels + c];
      }
      picture.image[pixel] += transmittance * view.background;
      picture.alpha[pixel] = T(1) - transmittance;
    }
  });
  return picture;
}

}  // namespace gs
