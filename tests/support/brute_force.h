// SPDX-License-Identifier: Apache-2.0
// The reference renderer: each Gaussian at each pixel in depth order, in double, without tiles,
// rectangles or early ends. For each pixel it also says whether a decision there (keep a fragment,
// end the pixel) depends on the last digits of a float.
#pragma once

#include "gs_core/gaussians.h"
#include "gs_core/math/render/blend.h"
#include "gs_core/math/spacetime/spacetime_splat.h"
#include "gs_render/render_pass.h"
#include "tests/support/test.h"

namespace gs {

/// The parameters of one Gaussian in double; number(k) addresses them one by one, in the order of
/// gaussians.h.
struct DoubleGaussian {
  Vec3d mean, log_scale;
  Quat<double> rotation;
  double logit_opacity;
  Vec3d sh0, sh_rest[kShRestCount];
  Quat<double> right_rotation{};  // of Gaussians in space and time
  double time_mean = 0, log_time_scale = 0;
  bool has_time = false;
  double filter_scale = 0;  // a parameter that has no gradient; 0: none

  double& number(int k) { return reinterpret_cast<double*>(this)[k]; }
};
inline constexpr int kNumbersPerGaussian = 65;
static_assert(offsetof(DoubleGaussian, has_time) == kNumbersPerGaussian * sizeof(double));

inline std::vector<DoubleGaussian> in_double(const Gaussians& from) {
  std::vector<DoubleGaussian> result(from.count());
  for (std::size_t i = 0; i < from.count(); ++i) {
    const Quatf& q = from.rotation[i];
    DoubleGaussian& g = result[i];
    g.mean = Vec3d(from.mean[i]);
    g.log_scale = Vec3d(from.log_scale[i]);
    g.rotation = {q.w, q.x, q.y, q.z};
    g.logit_opacity = from.logit_opacity[i];
    g.sh0 = Vec3d(from.sh0[i]);
    for (int k = 0; k < kShRestCount; ++k) g.sh_rest[k] = Vec3d(from.sh_rest[i].coefficient[k]);
    if (from.has_filter) g.filter_scale = from.filter_scale[i];
    if (!(g.has_time = from.has_time)) continue;
    const Quatf& r = from.right_rotation[i];
    g.right_rotation = {r.w, r.x, r.y, r.z};
    g.time_mean = from.time_mean[i];
    g.log_time_scale = from.log_time_scale[i];
  }
  return result;
}

/// The visible splats of a view, near to far, equal depths by index.
struct ReferenceSplats {
  struct Entry {
    std::uint32_t gaussian;
    double depth;
    BasicSplat<double> splat;
    RayDepth<double> ray{};  // in the order by pixel
  };
  std::vector<Entry> entries;
  double conic_error, mean_error;  // of a float renderer's splats: relative; pixels
};

/// Projects every Gaussian in the scalar T. With `float` the splats are exactly those of a renderer
/// in float, so that ill-conditioned ones (needles, huge ones) can be compared, too. With `double`
/// the renderer's rounding errors become visible.
template <class T, class CameraScalar>
ReferenceSplats reference_splats(const std::vector<DoubleGaussian>& gaussians,
                                 const PinholeCamera<CameraScalar>& camera,
                                 const RenderSettings& settings) {
  constexpr bool kExact = std::is_same_v<T, float>;
  // For exact splats, an offset from the mean is rounded to half a unit in the last place of 16
  // pixels. For others, a mean of some 100 pixels is a sum of rounded products, and a conic divides
  // by a difference of products.
  ReferenceSplats result{{}, kExact ? 0 : 1e-5, kExact ? 1e-6 : 3e-5};
  const PinholeCamera<T> camera_t = camera_as<T>(camera);
  for (std::uint32_t i = 0; i < gaussians.size(); ++i) {
    const DoubleGaussian& g = gaussians[i];
    Vec3<T> sh_rest[kShRestCount];
    for (int k = 0; k < kShRestCount; ++k) sh_rest[k] = Vec3<T>(g.sh_rest[k]);
    const GaussianParameters<T> parameters{
        Vec3<T>(g.mean),
        Vec3<T>(g.log_scale),
        {T(g.rotation.w), T(g.rotation.x), T(g.rotation.y), T(g.rotation.z)},
        T(g.logit_opacity),
        Vec3<T>(g.sh0),
        sh_rest,
        T(g.filter_scale)};
    const Quat<double>& r = g.right_rotation;
    const SpacetimeParameters<T> in_time{
        parameters, {T(r.w), T(r.x), T(r.y), T(r.z)}, T(g.time_mean), T(g.log_time_scale)};
    const ProjectedGaussian<T> p =
        g.has_time ? project_gaussian(camera_t, in_time, camera_t.time, settings)
                   : project_gaussian(camera_t, parameters, settings);
    if (!p.is_visible) continue;
    const BasicSplat<T>& s = p.splat;
    result.entries.push_back({i,
                              double(p.depth),
                              {Vec2<double>(s.mean2d),
                               {s.conic.xx, s.conic.xy, s.conic.yy},
                               s.opacity,
                               s.cutoff,
                               Vec3d(s.color),
                               double(s.variance_y),
                               double(p.depth)}});
    if (settings.order == RenderOrder::z) continue;
    const RayDepth<T> ray = ray_depth(camera_t, parameters);
    result.entries.back().ray = {ray.depth, Vec2<double>(ray.u), Vec2<double>(ray.v), ray.w};
  }
  std::stable_sort(result.entries.begin(), result.entries.end(),
                   [](const auto& a, const auto& b) { return a.depth < b.depth; });
  return result;
}

inline constexpr std::uint32_t kNoGaussian = ~0u;

struct ReferencePixel {
  Vec3d color{0.0};  // with background
  double transmittance = 1;
  std::uint32_t last = kNoGaussian;                 // the last one blended
  bool is_doubtful = false;                         // in float, a decision may fall the other way
  std::uint64_t decisions = 14695981039346656037u;  // FNV-1a hash of all decisions

  void decide(std::uint64_t what) { decisions = (decisions ^ what) * 1099511628211u; }
};

/// Renders one pixel from all splats.
template <BlendRule rule>
ReferencePixel reference_pixel(const ReferenceSplats& splats, const Vec3f& background, int x,
                               int y) {
  constexpr double kFloatRounding = 5e-7;  // eight roundings of 6e-8 on the terms of an exponent
  constexpr double kDoubt = 1e-5;  // besides the rounding: of alpha and of transmittance, relative
  ReferencePixel pixel;
  PixelState<double> state;
  double transmittance_error = kDoubt;  // relative
  for (const ReferenceSplats::Entry& entry : splats.entries) {
    const BasicSplat<double>& s = entry.splat;
    const Sym2<double>& Q = s.conic;
    const double dx = x + 0.5 - s.mean2d.x, dy = y + 0.5 - s.mean2d.y;
    const double exponent = fragment_exponent(Q, dx, dy);
    const double terms = Q.xx * dx * dx + 2 * std::abs(Q.xy * dx * dy) + Q.yy * dy * dy;
    const double slope = std::abs(Q.xx * dx + Q.xy * dy) + std::abs(Q.xy * dx + Q.yy * dy);
    const double error = (splats.conic_error + kFloatRounding) * terms + splats.mean_error * slope;
    if (std::abs(exponent + s.cutoff) < kDoubt + error) pixel.is_doubtful = true;
    if (exponent < -s.cutoff) continue;

    const double gaussian = std::exp(exponent);
    const double alpha = fragment_alpha<rule>(s.opacity, gaussian);
    const double remaining = state.transmittance * (1 - alpha);
    transmittance_error += alpha / std::max(1 - alpha, 1e-7) * (error + 1e-6);
    if (std::abs(remaining / kMinTransmittance - 1) < transmittance_error) pixel.is_doubtful = true;
    const bool ends = is_opaque(remaining);
    pixel.decide(entry.gaussian);
    pixel.decide((alpha < s.opacity * gaussian) + 2 * ends + 4 * (s.color.x >= 0) +
                 8 * (s.color.y >= 0) + 16 * (s.color.z >= 0));
    if (rule == BlendRule::classic && ends) break;
    composite(state, s.color, alpha);
    pixel.last = entry.gaussian;
    if (ends) break;
  }
  pixel.transmittance = state.transmittance;
  pixel.color = state.color + state.transmittance * Vec3d(background);
  return pixel;
}

struct ReferencePicture {
  int width, height;
  std::vector<ReferencePixel> pixels;  // (height, width)

  const ReferencePixel& at(int x, int y) const { return pixels[std::size_t(y) * width + x]; }
  /// Colors as (3, H, W), like RenderPass::image.
  std::vector<double> planes() const {
    std::vector<double> result(3 * pixels.size());
    for (std::size_t i = 0; i < pixels.size(); ++i)
      for (int c = 0; c < 3; ++c) result[c * pixels.size() + i] = pixels[i].color[c];
    return result;
  }
  /// Equal for two pictures with the same decisions at every pixel.
  std::uint64_t decisions() const {
    ReferencePixel all;
    for (const ReferencePixel& pixel : pixels) all.decide(pixel.decisions);
    return all.decisions;
  }
};

/// Those in front of the eye at a pixel, by their depth along its ray.
inline ReferenceSplats in_order_of_pixel(const ReferenceSplats& splats, int x, int y) {
  ReferenceSplats result{{}, splats.conic_error, splats.mean_error};
  for (ReferenceSplats::Entry entry : splats.entries) {
    entry.depth = entry.ray.at(x + 0.5 - entry.splat.mean2d.x, y + 0.5 - entry.splat.mean2d.y);
    if (entry.depth > 0) result.entries.push_back(entry);
  }
  std::stable_sort(result.entries.begin(), result.entries.end(),
                   [](const auto& a, const auto& b) { return a.depth < b.depth; });
  return result;
}

/// The whole picture.
inline ReferencePicture reference_picture(const ReferenceSplats& splats,
                                          const RenderSettings& settings, int width, int height) {
  ReferencePicture picture{width, height, {}};
  picture.pixels.reserve(std::size_t(width) * height);
  const auto pixel = [&](const ReferenceSplats& in_order, int x, int y) {
    return settings.blend_rule == BlendRule::classic
               ? reference_pixel<BlendRule::classic>(in_order, settings.background, x, y)
               : reference_pixel<BlendRule::faster_gs>(in_order, settings.background, x, y);
  };
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      picture.pixels.push_back(settings.order == RenderOrder::pixel
                                   ? pixel(in_order_of_pixel(splats, x, y), x, y)
                                   : pixel(splats, x, y));
  return picture;
}

}  // namespace gs
