// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/importance.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "gs_app/run/progress_bar.h"
#include "gs_core/math/density/density.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

// Two variances that differ by a smaller share of their sum have no axes that a turn could show.
constexpr double kLeastDifference = 1e-3;

// dL by an entry of the covariance in the Gaussian's axes, from dL by a turn about the third axis:
//   d(Sigma_ab) = (v_a - v_b) d(angle)
double by_covariance(double dL_dangle, double a, double b) {
  return std::abs(a - b) > kLeastDifference * (a + b) ? dL_dangle / (a - b) : 0;
}

/// |dL / dSigma_n|, Sigma_n = Sigma / |s|^2, entries xx xy xz yy yz zz.
std::array<double, 6> shape_gradient(const Quatf& rotation, const Vec3f& log_scale,
                                     const Quatf& dL_drotation, const Vec3f& dL_dlog_scale) {
  const Quat<double> q = in_double(rotation), g = in_double(dL_drotation);
  if (is_degenerate(q)) return {};
  const Vec3d v{std::exp(2.0 * log_scale.x), std::exp(2.0 * log_scale.y),
                std::exp(2.0 * log_scale.z)};
  const auto by_turn = [&](const Quat<double>& axis) {  // q' = q (1 + angle / 2 axis)
    const Quat<double> t = product(q, axis);
    return 0.5 * (g.w * t.w + g.x * t.x + g.y * t.y + g.z * t.z);
  };
  const auto by_variance = [](double dL_dlog, double variance) {
    return variance > 0 ? dL_dlog / (2 * variance) : 0;
  };
  // The gradient G of dL = sum G_ij dSigma_ij, in the axes of the Gaussian.
  const Sym3<double> G{by_variance(dL_dlog_scale.x, v.x),
                       0.5 * by_covariance(by_turn({0, 0, 0, 1}), v.x, v.y),
                       0.5 * by_covariance(by_turn({0, 0, 1, 0}), v.z, v.x),
                       by_variance(dL_dlog_scale.y, v.y),
                       0.5 * by_covariance(by_turn({0, 1, 0, 0}), v.y, v.z),
                       by_variance(dL_dlog_scale.z, v.z)};
  const Mat3<double> R = rotation_matrix(q);
  const Vec3d x = multiply(G, R.row0), y = multiply(G, R.row1), z = multiply(G, R.row2);
  const double size = v.x + v.y + v.z;
  const double in_world[] = {inner(R.row0, x), 2 * inner(R.row0, y), 2 * inner(R.row0, z),
                             inner(R.row1, y), 2 * inner(R.row1, z), inner(R.row2, z)};
  std::array<double, 6> result;
  for (int k = 0; k < 6; ++k) result[std::size_t(k)] = std::abs(in_world[k]) * size;
  return result;
}

/// Sums over views of absolute gradients.
struct Sums {
  std::array<double, 6> shape{};
  Vec3f sh0{0};
  ShRest sh_rest{};
};

Vec3f absolute(const Vec3f& v) { return {std::abs(v.x), std::abs(v.y), std::abs(v.z)}; }

void add(Sums& sums, const Gaussians& host, const Gaussians& gradients, std::size_t i) {
  sums.sh0 += absolute(gradients.sh0[i]);
  for (int k = 0; k < kShRestCount; ++k)
    sums.sh_rest.coefficient[k] += absolute(gradients.sh_rest[i].coefficient[k]);
  const std::array<double, 6> shape = shape_gradient(host.rotation[i], host.log_scale[i],
                                                     gradients.rotation[i], gradients.log_scale[i]);
  for (std::size_t k = 0; k < shape.size(); ++k) sums.shape[k] += shape[k];
}

}  // namespace

RowImportance importance_of(const Viewpoints& viewpoints, const Gaussians& host,
                            const std::vector<Camera>& cameras) {
  Renderer& renderer = viewpoints.backend.renderer();
  Memory& memory = renderer.memory();
  RenderSettings settings = viewpoints.settings;
  settings.background = Vec3f(0);
  settings.absolute_gradient = false;
  settings.for_backward = true;
  const std::size_t count = host.count();
  Gaussians gradients(count, memory, host.has_time);
  Buffer<Vec2f> dL_dmean2d(count, memory);
  Buffer<float> ones(memory);
  RenderPass pass(memory);
  std::vector<Sums> sums(count);
  double pixels = 0;
  ProgressBar bar(std::int64_t(cameras.size()), true);
  std::int64_t done = 0;
  for (const Camera& camera : cameras) {
    const std::size_t plane = std::size_t(camera.width) * std::size_t(camera.height);
    if (ones.size() != 3 * plane) ones.upload(std::vector<float>(3 * plane, 1.0f));
    renderer.forward(viewpoints.original, camera, settings, pass);
    renderer.backward(viewpoints.original, camera, settings, pass, ones.span(), gradients.span(),
                      dL_dmean2d.span());
    const Gaussians on_host = copy_of(gradients, host_memory());
    parallel_for(count, 1024, [&](std::size_t i) { add(sums[i], host, on_host, i); });
    pixels += double(plane);
    if (bar.due(++done)) bar.draw(done, "importance", "view");
  }
  bar.clear();
  RowImportance importance{std::vector<float>(count), std::vector<float>(count)};
  for (std::size_t i = 0; i < count; ++i) {
    float color = largest(sums[i].sh0);
    for (const Vec3f& c : sums[i].sh_rest.coefficient) color = std::max(color, largest(c));
    importance.color[i] = float(color / pixels);
    importance.shape[i] =
        float(*std::max_element(sums[i].shape.begin(), sums[i].shape.end()) / pixels);
  }
  return importance;
}

}  // namespace gs
