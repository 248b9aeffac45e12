// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/split_panoramas.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>
#include <utility>

#include "data_loaders/counted.h"
#include "data_loaders/lenses/hemispheres.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_core/math/render/quaternion.h"

namespace gs {
namespace {

std::string name_of_half(const std::string& panorama, bool is_back) {
  const std::string stem = without_extension(panorama);
  return stem + (is_back ? ".back" : ".front") + panorama.substr(stem.size());
}

/// The half behind, without observations: half a turn around the camera's y axis.
ColmapImage turned_back(const ColmapImage& front) {
  ColmapImage back = front;
  const Vec3d& t = front.cam_from_world_translation;
  back.cam_from_world_rotation = product({0, 0, 1, 0}, front.cam_from_world_rotation);
  back.cam_from_world_translation = {-t.x, t.y, -t.z};
  back.observations.clear();
  return back;
}

/// Gives each of the two its share of the panorama's observations, all of which the front has.
void share_observations(const ColmapCamera& camera, ColmapImage& front, ColmapImage& back) {
  const auto all = std::exchange(front.observations, {});
  for (const ColmapObservation& seen : all) {
    const HemispherePixel at = hemisphere_pixel(camera, {seen.x, seen.y});
    (at.is_back ? back : front).observations.push_back({seen.point_id, at.pixel.x, at.pixel.y});
  }
}

/// Makes the two one frame: that of the panorama, or a new one.
void add_to_frame(ColmapModel& model, std::uint32_t front, std::uint32_t back) {
  for (ColmapFrame& frame : model.frames)
    if (std::ranges::find(frame.image_ids, front) != frame.image_ids.end())
      return frame.image_ids.push_back(back);
  model.frames.push_back({0, 0, {front, back}});
}

}  // namespace

std::vector<SplitImage> split_panoramas(ColmapModel& model) {
  const bool was_sorted = std::ranges::is_sorted(model.images, {}, &ColmapImage::name);
  std::set<std::uint32_t> ids;
  for (const ColmapImage& image : model.images) ids.insert(image.id);
  std::uint32_t next_id = 1;
  std::vector<std::pair<ColmapImage, SplitImage>> split;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    ColmapImage& image = model.images[i];
    const ColmapCamera& camera = model.cameras.at(image.camera_id);
    if (camera.model == CameraModel::equirectangular) {
      ColmapImage back = turned_back(image);
      while (!ids.insert(next_id).second) ++next_id;
      back.id = next_id;
      back.name = name_of_half(image.name, true);
      image.name = name_of_half(image.name, false);
      share_observations(camera, image, back);
      add_to_frame(model, image.id, back.id);
      split.emplace_back(std::move(back), SplitImage{i, true});
    }
    split.emplace_back(std::move(image), SplitImage{i, false});
  }
  if (was_sorted)
    std::ranges::sort(
        split, {}, [](const auto& half) -> auto& { return half.first.name; });
  model.images.clear();
  std::vector<SplitImage> origins;
  for (auto& [image, origin] : split) {
    model.images.push_back(std::move(image));
    origins.push_back(origin);
  }
  return origins;
}

std::size_t split_panoramas(SceneModel& scene) {
  const auto is_panorama = [](const auto& camera) {
    return camera.second.model == CameraModel::equirectangular;
  };
  if (std::ranges::none_of(scene.model.cameras, is_panorama)) return 0;
  const std::vector<Photo> before = std::exchange(scene.photos, {});
  const std::vector<SplitImage> origins = split_panoramas(scene.model);
  for (std::size_t i = 0; i < origins.size(); ++i) {
    Photo& photo = scene.photos.emplace_back(before[origins[i].image]);
    photo.name = scene.model.images[i].name;
    photo.is_back = origins[i].is_back;
  }
  return scene.photos.size() - before.size();
}

std::string text_of_panoramas(std::size_t count) {
  return fmt::format(
      "{} as two fisheye views each, NAME.front and NAME.back, which reach {} degrees from the "
      "panorama's center and from its opposite",
      counted(count, "panorama", "trains", "train"), kHemisphereDegrees);
}

PhotoSize picture_size(const PhotoSize& file, const ColmapCamera& camera) {
  if (camera.model != CameraModel::equirectangular || file.width == 0) return file;
  const int side = hemisphere_side(file.width);
  return {side, side};
}

}  // namespace gs
