// SPDX-License-Identifier: Apache-2.0
// Random models for tests of files, and the errors of reading broken files.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "gs_core/error.h"
#include "gs_core/math/random.h"
#include "gs_model/formats/ply/ply_layout.h"

namespace gs {

/// Gaussians in which every number differs, with rotations of length 1.
inline GaussianModel random_model(std::size_t count, int sh_degree) {
  GaussianModel model;
  model.sh_degree = sh_degree;
  model.gaussians.resize(count);
  model.gaussians.fill_zero();
  const Random random{7, RandomStream::test};
  const auto columns = gaussian_columns(model.gaussians, sh_degree);
  for (std::size_t c = 0; c < columns.size(); ++c) {
    for (std::size_t i = 0; i < count; ++i) {
      columns[c].array[i * columns[c].stride + columns[c].offset] = random.normal4(i, c).x;
    }
  }
  for (Quatf& q : model.gaussians.rotation) {
    const float length = std::sqrt(squared_norm(q));
    q = {q.w / length, q.x / length, q.y / length, q.z / length};
  }
  return model;
}

/// The same in space and time.
inline GaussianModel random_moving_model(std::size_t count, int sh_degree) {
  GaussianModel model = random_model(count, sh_degree);
  model.gaussians.has_time = true;
  model.gaussians.resize(count);
  const Random random{8, RandomStream::test};
  for (std::size_t i = 0; i < count; ++i) {
    const auto q = random.normal4(i, 0), time = random.normal4(i, 1);
    model.gaussians.right_rotation[i] = {q.x, q.y, q.z, q.w};
    model.gaussians.time_mean[i] = 0.5f + 0.3f * time.x;
    model.gaussians.log_time_scale[i] = -1 + 0.5f * time.y;
  }
  return model;
}

}  // namespace gs
