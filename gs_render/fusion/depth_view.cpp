// SPDX-License-Identifier: Apache-2.0
#include "gs_render/fusion/depth_view.h"

#include <utility>

#include "gs_core/threads/parallel.h"

namespace gs {

DepthView depth_view(const Camera& camera, ImageF inverse_depth, Image8 color) {
  DepthView view{camera, std::move(inverse_depth), {}, std::move(color)};
  view.facing.resize(view.inverse_depth.pixels.size());
  const DepthPicture picture = view.picture();
  parallel_for(std::size_t(camera.height), 8, [&](std::size_t y) {
    for (int x = 0; x < camera.width; ++x)
      view.facing[picture.pixel(x, int(y))] = picture.facing_of(x, int(y));
  });
  return view;
}

}  // namespace gs
