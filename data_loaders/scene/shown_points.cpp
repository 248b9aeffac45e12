// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/shown_points.h"

#include "data_loaders/refine/tracks.h"
#include "gs_core/threads/parallel.h"
#include "gs_model/edit/select.h"

namespace gs {
namespace {

ShownPoints points_of_tracks(const ColmapModel& model) {
  ShownPoints shown;
  for (const std::vector<SeenPoint>& seen : seen_points(model, "dataset.photo_list")) {
    shown.emplace_back();
    for (const SeenPoint& point : seen) shown.back().push_back(point.point);
  }
  return shown;
}

ShownPoints points_in_pictures(const std::vector<Camera>& cameras,
                               const std::vector<ScenePoint>& points) {
  ShownPoints shown(cameras.size());
  parallel_for(cameras.size(), 1, [&](std::size_t c) {
    for (std::uint32_t p = 0; p < points.size(); ++p)
      if (is_in_picture(cameras[c], points[p].position)) shown[c].push_back(p);
  });
  return shown;
}

}  // namespace

ShownPoints shown_points(const ColmapModel& model, const std::vector<Camera>& cameras,
                         const std::vector<ScenePoint>& points) {
  return has_tracks(model) ? points_of_tracks(model) : points_in_pictures(cameras, points);
}

std::vector<bool> points_shown_by(const ShownPoints& shown, const std::vector<bool>& is_used,
                                  std::size_t point_count) {
  std::vector<bool> is_shown(point_count, false);
  for (std::size_t i = 0; i < shown.size(); ++i)
    if (is_used[i])
      for (const std::uint32_t point : shown[i]) is_shown[point] = true;
  return is_shown;
}

}  // namespace gs
