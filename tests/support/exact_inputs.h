// SPDX-License-Identifier: Apache-2.0
// Random inputs of the exact renderer.
#pragma once

#include "gs_render/exact/exact_renderer.h"
#include "tests/support/numbers.h"

namespace gs {

/// All inputs of a picture.
template <class T>
struct ExactInputs {
  ExactGaussians<T> gaussians;
  ExactView<T> view;
};

/// Which arrays there are.
struct InputShape {
  int sh_degree;  // -1: colors
  int channels;
  bool has_covariances;
  bool antialias;
};
/// Gaussians in front of a camera with a picture of width x height pixels; a few are behind it, or
/// beside the picture.
inline ExactInputs<double> draw_inputs(TestRandom& random, const InputShape& shape, int count,
                                       int width, int height) {
  ExactInputs<double> in;
  in.view.camera = {width,
                    height,
                    width * random.uniform(0.67, 1.17),
                    width * random.uniform(0.67, 1.17),
                    width * 0.45,
                    height * 0.55,
                    rotation_matrix(random.quaternion()),
                    random.uniform3(-1, 1)};
  in.view.background = random.uniform3(0, 1);
  ExactGaussians<double>& g = in.gaussians;
  g.sh_degree = std::max(shape.sh_degree, 0);
  g.channels = shape.channels;
  for (int i = 0; i < count; ++i) {
    const double z = random.chance(0.1) ? -1 : random.uniform(1, 5);
    const Vec3d p{z * random.uniform(-0.9, 0.9), z * random.uniform(-0.8, 0.8), z};
    g.means.push_back(multiply_transposed(in.view.camera.cam_from_world_rotation,
                                          p - in.view.camera.cam_from_world_translation));
    const Quat<double> q = random.quaternion();
    const Vec3d log_scale = random.uniform3(-2.5, -0.3);
    if (shape.has_covariances) {
      g.covariances.push_back(covariance(rotation_matrix(q), variance(log_scale)));
    } else {
      g.rotations.push_back(q);
      g.log_scales.push_back(log_scale);
    }
    g.opacities.push_back(random.uniform(0.02, 1.0));
    if (shape.sh_degree < 0) g.colors.push_back(random.uniform3(-0.2, 1));
    for (std::size_t k = 0; shape.sh_degree >= 0 && k < g.sh_count(); ++k)
      g.sh.push_back(random.uniform3(-1.2, 1.2));
    for (int c = 0; c < shape.channels; ++c) g.features.push_back(random.uniform(-1, 1));
    in.view.screen.push_back({random.uniform(-1, 1), random.uniform(-1, 1)});
  }
  return in;
}

/// dL by every number of a picture.
inline ExactPicture<double> draw_picture_gradient(TestRandom& random, int channels, int width,
                                                  int height) {
  const std::size_t pixels = std::size_t(width) * height;
  ExactPicture<double> dL;
  for (std::size_t i = 0; i < pixels; ++i) {
    dL.image.push_back(random.uniform3(-1, 1));
    dL.alpha.push_back(random.uniform(-1, 1));
    dL.depth.push_back(random.uniform(-1, 1));
    dL.inverse_depth.push_back(random.uniform(-1, 1));
  }
  for (std::size_t i = 0; i < pixels * std::size_t(channels); ++i)
    dL.features.push_back(random.uniform(-1, 1));
  return dL;
}

}  // namespace gs
