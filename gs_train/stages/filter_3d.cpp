// SPDX-License-Identifier: Apache-2.0
// Stage 9 with model.filter_3d: each row's 3D filter, from all training cameras (math/filter_3d.h).
#include "gs_core/math/render/filter_3d.h"

#include <algorithm>

#include "gs_core/threads/parallel.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {

void measure_filter(TrainingModel& model, const std::vector<Camera>& cameras, float near_plane) {
  Gaussians& rows = model.gaussians;
  rows.filter_scale.resize(rows.count());
  rows.has_filter = true;
  parallel_for(rows.count(), 256, [&](std::size_t i) {
    float rate = 0;
    for (const Camera& camera : cameras)
      rate = std::max(rate, sampling_rate(camera, rows.mean[i], near_plane));
    rows.filter_scale[i] = rate > 0 ? filter_scale_of(rate) : 0;
  });
  float largest = 0;
  for (const float scale : rows.filter_scale) largest = std::max(largest, scale);
  for (float& scale : rows.filter_scale)
    if (scale == 0) scale = largest;  // no camera sees it
}

}  // namespace gs
