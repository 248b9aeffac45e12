// SPDX-License-Identifier: Apache-2.0
// Stage 1 of one Gaussian as a function of 11 numbers, and its gradient against Jets.
#pragma once

#include "gs_core/math/render/splat.h"
#include "tests/support/jet_oracle.h"

namespace gs {

/// flat: mean, log scale, rotation, logit opacity.
template <class T>
ProjectedGaussian<T> project_flat(const PinholeCamera<double>& camera,
                                  const SplatSettings& settings, const std::array<T, 11>& flat) {
  Unflatten in(flat);
  const Vec3<T> mean = in.vec3(), log_scale = in.vec3();
  const Quat<T> rotation = in.quat();
  return project_shape(camera_as<T>(camera), mean, log_scale, rotation, in.scalar(), T(0),
                       settings);
}

/// The worst error of the gradient by mean2d, conic, opacity and depth, over `cases` Gaussians of
/// `draw`, which may change the camera.
template <class Draw>
double worst_flat_gradient_error(const PinholeCamera<double>& camera, const SplatSettings& settings,
                                 Draw&& draw, int cases) {
  return worst_gradient_error(
      [&](const auto& x) {
        const auto splat = project_flat(camera, settings, x).splat;
        return flatten(splat.mean2d, splat.conic, splat.opacity, splat.depth);
      },
      [&](const auto& x, const auto& dL) {
        Unflatten in(x);
        const Vec3d mean = in.vec3(), log_scale = in.vec3();
        const Quat<double> rotation = in.quat();
        Unflatten g(dL);
        BasicSplatGradient<double> gradient;
        gradient.mean2d = g.vec2();
        gradient.conic = gradient_matrix(g.sym2());
        gradient.opacity = g.scalar();
        gradient.color = Vec3d(0.0);
        gradient.depth = g.scalar();
        const auto grads = project_shape_vjp(camera, mean, log_scale, rotation, in.scalar(), 0.0,
                                             settings, gradient);
        return flatten(grads.mean, grads.log_scale, grads.rotation, grads.logit_opacity);
      },
      draw, cases);
}

}  // namespace gs
