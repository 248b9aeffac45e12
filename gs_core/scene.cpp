// SPDX-License-Identifier: Apache-2.0
#include "gs_core/scene.h"

#include <algorithm>

#include "gs_core/geometry/outliers.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/constants.h"

namespace gs {
namespace {

bool is_elsewhere(const View& view) { return view.source && view.photo.empty(); }

}  // namespace

std::shared_ptr<const View> with_photo(const View& view) {
  if (is_elsewhere(view)) {
    const std::shared_ptr<const View> decoded = view.source->view(view.index);
    if (decoded->exposure == view.exposure) return decoded;
    const auto exposed = std::make_shared<View>(*decoded);  // solved for after the source was made
    exposed->exposure = view.exposure;
    return exposed;
  }
  return {std::shared_ptr<void>(), &view};  // owns nothing
}

void prefetch_photo(const View& view) {
  if (is_elsewhere(view)) view.source->prefetch_decode(view.index);
}

void release_photo(const View& view) {
  if (is_elsewhere(view)) view.source->release(view.index);
}

std::size_t photo_bytes(const View& view) {
  if (!is_elsewhere(view)) return view.photo.pixels.size() + view.mask.pixels.size();
  return (view.may_be_masked ? 4 : 3) * std::size_t(view.camera.width) *
         std::size_t(view.camera.height);
}

std::size_t map_bytes(const View& view) {
  return ((view.has_depth_map ? sizeof(float) : 0) + (view.has_normal_map ? 3 : 0)) *
         std::size_t(view.camera.width) * std::size_t(view.camera.height);
}

bool have_depth_maps(const std::vector<View>& views) {
  return std::ranges::any_of(views, &View::has_depth_map);
}
bool have_normal_maps(const std::vector<View>& views) {
  return std::ranges::any_of(views, &View::has_normal_map);
}

std::string text_of_moving_scene(std::size_t time_count) {
  return "the scene moves: its photos were taken at " + std::to_string(time_count) +
         " different times; it is trained as a static scene, so everything that moves becomes "
         "blurred; train it with -c dynamic";
}

std::vector<std::size_t> outlier_cameras(const std::vector<View>& views) {
  std::vector<Vec3d> positions;
  for (const View& view : views) positions.push_back(Vec3d(view.camera.position()));
  return outlier_positions(positions);
}

float camera_extent(const std::vector<View>& views) {
  const std::vector<std::size_t> outliers = outlier_cameras(views);
  std::vector<Vec3d> positions;
  for (std::size_t i = 0; i < views.size(); ++i)
    if (!std::binary_search(outliers.begin(), outliers.end(), i))
      positions.push_back(Vec3d(views[i].camera.position()));
  Vec3d mean(0.0);
  for (const Vec3d& position : positions) mean += position;
  mean /= double(std::max<std::size_t>(positions.size(), 1));
  double farthest = 0;
  for (const Vec3d& position : positions) farthest = std::max(farthest, length(position - mean));
  return farthest > 0 ? kExtentMargin * float(farthest) : 1.0f;
}

}  // namespace gs
