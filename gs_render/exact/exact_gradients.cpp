// SPDX-License-Identifier: Apache-2.0
// The backward pass of exact_renderer.h, by hand; tests compare it with Jets.
#include "gs_render/exact/exact_renderer.h"

namespace gs {
namespace {

// The picture is divided into as many parts, each with sums of its own, which are added up in their
// order: the result does not depend on the number of threads.
constexpr std::size_t kParts = 16;

/// What the pixels of one part add to gradients.
struct PixelSums {
  std::vector<BasicSplatGradient<double>> splats;  // (N)
  std::vector<Vec2<double>> absolute;              // (N)  by the projected means
  std::vector<double> features;                    // (N, channels)
  Vec3d background{0.0};

  explicit PixelSums(const ExactGaussians<double>& gaussians)
      : splats(gaussians.count(), {{0, 0}, {0, 0, 0}, 0, {0, 0, 0}, 0}),
        absolute(gaussians.count(), {0, 0}), features(gaussians.features.size(), 0) {}

  void add(const PixelSums& other) {
    for (std::size_t i = 0; i < splats.size(); ++i) {
      BasicSplatGradient<double>& sum = splats[i];
      const BasicSplatGradient<double>& more = other.splats[i];
      sum.mean2d += more.mean2d;
      absolute[i] += other.absolute[i];
      sum.conic.xx += more.conic.xx;
      sum.conic.xy += more.conic.xy;
      sum.conic.yy += more.conic.yy;
      sum.opacity += more.opacity;
      sum.color += more.color;
      sum.depth += more.depth;
    }
    for (std::size_t k = 0; k < features.size(); ++k) features[k] += other.features[k];
    background += other.background;
  }
};

/// dL by one pixel; zeros where an array is empty.
struct PixelGradient {
  Vec3d image{0.0};
  double alpha = 0, depth = 0, inverse_depth = 0;
  const double* features = nullptr;  // (channels), or null

  PixelGradient(const ExactPicture<double>& dL, std::size_t pixel, std::size_t channels) {
    if (!dL.image.empty()) image = dL.image[pixel];
    if (!dL.alpha.empty()) alpha = dL.alpha[pixel];
    if (!dL.depth.empty()) depth = dL.depth[pixel];
    if (!dL.inverse_depth.empty()) inverse_depth = dL.inverse_depth[pixel];
    if (!dL.features.empty()) features = &dL.features[pixel * channels];
  }
};

void check_gradient_sizes(const ExactPicture<double>& dL, std::size_t pixels,
                          std::size_t channels) {
  const auto expect = [](const char* name, std::size_t size, std::size_t expected) {
    if (size != 0 && size != expected)
      throw UsageError(std::string("the gradient by ") + name + " has " + std::to_string(size) +
                       " values, but the picture has " + std::to_string(expected));
  };
  expect("image", dL.image.size(), pixels);
  expect("alpha", dL.alpha.size(), pixels);
  expect("depth", dL.depth.size(), pixels);
  expect("inverse_depth", dL.inverse_depth.size(), pixels);
  expect("features", dL.features.size(), pixels * channels);
}

/// Stage 6 of one pixel. With q_i, what a whole unit of fragment i adds to L, and B_i, what all
/// behind it adds for a unit of transmittance:
///
///   B_last = <background, g> - dL/dA,   dL/dalpha_i = T_i (q_i - B_i),
///   B_(i-1) = alpha_i q_i + (1 - alpha_i) B_i
void blend_backward(const ExactGaussians<double>& gaussians, const ExactView<double>& view,
                    const ExactSettings& settings, const PixelGradient& dL,
                    const std::vector<ExactFragment<double>>& fragments, PixelSums& sums) {
  const std::size_t channels = std::size_t(gaussians.channels);
  double behind = inner(view.background, dL.image) - dL.alpha;
  for (std::size_t k = fragments.size(); k-- > 0;) {
    const ExactFragment<double>& fragment = fragments[k];
    const ExactSplat<double>& splat = *fragment.splat;
    const double weight = fragment.transmittance * fragment.alpha;
    BasicSplatGradient<double>& row = sums.splats[splat.row];
    double unit = inner(splat.splat.color, dL.image) + splat.depth * dL.depth +
                  dL.inverse_depth / splat.depth;
    if (dL.features)
      for (std::size_t c = 0; c < channels; ++c) {
        const std::size_t at = splat.row * channels + c;
        unit += gaussians.features[at] * dL.features[c];
        sums.features[at] += weight * dL.features[c];
      }
    row.color += weight * dL.image;
    row.depth += weight * (dL.depth - dL.inverse_depth / (splat.depth * splat.depth));
    const double dL_dalpha = fragment.transmittance * (unit - behind);
    behind = fragment.alpha * unit + (1 - fragment.alpha) * behind;
    const AlphaGradient<double> by_alpha =
        settings.is_classic() ? fragment_alpha_vjp<BlendRule::classic>(splat.splat.opacity,
                                                                       fragment.gaussian, dL_dalpha)
                              : fragment_alpha_vjp<BlendRule::faster_gs>(
                                    splat.splat.opacity, fragment.gaussian, dL_dalpha);
    const ExponentGradient<double> by_exponent =
        fragment_exponent_vjp(splat.splat.conic, fragment.dx, fragment.dy, by_alpha.exponent);
    row.opacity += by_alpha.opacity;
    row.mean2d += by_exponent.mean2d;
    sums.absolute[splat.row] +=
        Vec2<double>{std::abs(by_exponent.mean2d.x), std::abs(by_exponent.mean2d.y)};
    row.conic.xx += by_exponent.conic.xx;
    row.conic.xy += by_exponent.conic.xy;
    row.conic.yy += by_exponent.conic.yy;
  }
}

/// Stage 6 of all pixels.
PixelSums sums_over_pixels(const ExactGaussians<double>& gaussians, const ExactView<double>& view,
                           const ExactSettings& settings,
                           const std::vector<ExactSplat<double>>& splats,
                           const ExactPicture<double>& dL_dpicture) {
  const std::size_t width = std::size_t(view.camera.width),
                    channels = std::size_t(gaussians.channels);
  const std::size_t pixels = width * std::size_t(view.camera.height);
  std::vector<PixelSums> parts(kParts, PixelSums(gaussians));
  parallel_for(kParts, 1, [&](std::size_t part) {
    std::vector<ExactFragment<double>> fragments;
    for (std::size_t pixel = pixels * part / kParts; pixel < pixels * (part + 1) / kParts;
         ++pixel) {
      const PixelGradient dL(dL_dpicture, pixel, channels);
      const double transmittance =
          exact_fragments(splats, settings, int(pixel % width), int(pixel / width), fragments);
      parts[part].background += transmittance * dL.image;
      blend_backward(gaussians, view, settings, dL, fragments, parts[part]);
    }
  });
  for (std::size_t part = 1; part < kParts; ++part) parts[0].add(parts[part]);
  return std::move(parts[0]);
}

/// Stage 7 of one visible row.
void project_backward(const ExactGaussians<double>& gaussians, const ExactView<double>& view,
                      const SplatSettings& settings, const BasicSplatGradient<double>& dL_dsplat,
                      std::size_t i, ExactGradients& gradients) {
  const Vec3d& mean = gaussians.means[i];
  const Sym3<double> sigma = exact_covariance(gaussians, i);
  const EllipsoidInCameraGradient<double> dL =
      project_ellipsoid_in_camera_vjp(view.camera, to_camera(view.camera, mean), sigma,
                                      gaussians.opacities[i], settings, dL_dsplat);
  gradients.means[i] = to_camera_vjp(view.camera, dL.p);
  gradients.opacities[i] = dL.opacity;
  gradients.screen[i] = dL_dsplat.mean2d;
  gradients.camera.add(camera_entries_vjp(view.camera, mean, dL, dL_dsplat.mean2d));
  if (gaussians.covariances.empty()) {
    const Mat3<double> R = rotation_matrix(gaussians.rotations[i]);
    const Vec3d variances = variance(gaussians.log_scales[i]);
    const CovarianceGradient<double> by_shape = covariance_vjp(R, variances, dL.sigma);
    gradients.log_scales[i] = variance_vjp(variances, by_shape.variance);
    gradients.rotations[i] = rotation_matrix_vjp(gaussians.rotations[i], by_shape.R);
  } else {
    const Sym3<double>& G = dL.sigma;  // twice, because a stored number stands at two places
    gradients.covariances[i] = {G.xx, 2 * G.xy, 2 * G.xz, G.yy, 2 * G.yz, G.zz};
  }
  if (gaussians.sh.empty()) {
    gradients.colors[i] = dL_dsplat.color;
    return;
  }
  const std::size_t first = i * gaussians.sh_count();
  const int degree = gaussians.sh_degree;
  const Vec3d eye = view.camera.position(), direction = unit_direction(eye, mean);
  const Vec3d color = sh_color(degree, direction, gaussians.sh[first], &gaussians.sh[first] + 1);
  const Vec3d& g = dL_dsplat.color;
  const Vec3d dL_dcolor{color.x >= 0 ? g.x : 0, color.y >= 0 ? g.y : 0, color.z >= 0 ? g.z : 0};
  const ShColorGradient<double> by_color = sh_color_vjp(degree, direction, &gaussians.sh[first] + 1,
                                                        dL_dcolor, &gradients.sh[first] + 1);
  gradients.sh[first] = by_color.sh0;
  const Vec3d by_mean = unit_direction_vjp(eye, mean, by_color.direction);
  gradients.means[i] += by_mean;
  gradients.camera.add(camera_entries_by_color_vjp(view.camera, by_mean));
}

ExactGradients zeros_like(const ExactGaussians<double>& gaussians) {
  const std::size_t n = gaussians.count();
  ExactGradients gradients;
  gradients.means.assign(n, Vec3d(0.0));
  gradients.rotations.assign(gaussians.rotations.size(), {0, 0, 0, 0});
  gradients.log_scales.assign(gaussians.log_scales.size(), Vec3d(0.0));
  gradients.covariances.assign(gaussians.covariances.size(), {0, 0, 0, 0, 0, 0});
  gradients.opacities.assign(n, 0);
  gradients.colors.assign(gaussians.colors.size(), Vec3d(0.0));
  gradients.sh.assign(gaussians.sh.size(), Vec3d(0.0));
  gradients.screen.assign(n, {0, 0});
  gradients.sh_degree = gaussians.sh_degree;
  gradients.channels = gaussians.channels;
  return gradients;
}

}  // namespace

ExactGradients exact_gradients(const ExactGaussians<double>& gaussians,
                               const ExactView<double>& view, const ExactSettings& settings,
                               const ExactPicture<double>& dL_dpicture) {
  check_sizes(gaussians, view);
  check_gradient_sizes(dL_dpicture,
                       std::size_t(view.camera.width) * std::size_t(view.camera.height),
                       std::size_t(gaussians.channels));
  const std::vector<ExactSplat<double>> splats = exact_splats(gaussians, view, settings);
  PixelSums sums = sums_over_pixels(gaussians, view, settings, splats, dL_dpicture);

  ExactGradients gradients = zeros_like(gaussians);
  gradients.features = std::move(sums.features);
  gradients.absolute_screen = std::move(sums.absolute);
  gradients.background = sums.background;
  const SplatSettings splat_settings = splat_settings_of(settings);
  for (const ExactSplat<double>& splat : splats)
    project_backward(gaussians, view, splat_settings, sums.splats[splat.row], splat.row, gradients);
  return gradients;
}

}  // namespace gs
