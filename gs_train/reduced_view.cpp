// SPDX-License-Identifier: Apache-2.0
#include "gs_train/reduced_view.h"

#include "gs_core/error.h"
#include "gs_core/math/loss/area_filter.h"
#include "gs_core/math/render/normal_map.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"

namespace gs {

View reduced_view(const View& view, int factor) {
  const HostStage stage("photo");
  const int width = view.photo.width;
  GS_CHECK(width == view.camera.width && view.photo.height == view.camera.height);
  View result;
  result.name = view.name;
  result.camera = reduced(view.camera, factor);
  result.over_background = view.over_background;
  result.exposure = view.exposure;
  result.photo = Image8(result.camera.width, result.camera.height, 3);
  if (!view.mask.empty()) result.mask = Image8(result.camera.width, result.camera.height, 1);
  result.depth_kind = view.depth_kind;
  result.has_depth_map = view.has_depth_map;
  if (!view.depth.empty()) result.depth = ImageF(result.camera.width, result.camera.height, 1);
  result.has_normal_map = view.has_normal_map;
  if (!view.normals.empty()) result.normals = Image8(result.camera.width, result.camera.height, 3);
  const NormalMap normals{view.normals.pixels.data(), width, factor};
  const PhotoBytes from{view.photo.pixels.data(),
                        view.mask.empty() ? nullptr : view.mask.pixels.data()};
  parallel_for(std::size_t(result.camera.height), 8, [&](std::size_t row) {
    const int y = int(row);
    for (int x = 0; x < result.camera.width; ++x) {
      for (int c = 0; c < 3; ++c)
        result.photo.at(x, y, c) = reduced_value(from, width, factor, x, y, c);
      if (from.mask) result.mask.at(x, y, 0) = reduced_mask(from, width, factor, x, y);
      if (!view.depth.empty())
        result.depth.at(x, y, 0) = reduced_depth(view.depth.pixels.data(), width, factor, x, y);
      if (!view.normals.empty()) {
        const NormalBytes n = normals.at(x, y);
        std::uint8_t* const to = &result.normals.at(x, y, 0);
        to[0] = n.x, to[1] = n.y, to[2] = n.z;
      }
    }
  });
  return result;
}

}  // namespace gs
