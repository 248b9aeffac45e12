// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/cameras/read_cameras.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <optional>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/lenses/lens_range.h"
#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/split_panoramas.h"
#include "data_loaders/transforms/transforms_json.h"
#include "gs_core/error.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/byte_reader.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// The character that JSON begins with; 0 where there is none.
char first_character(const fs::path& file) {
  ByteReader reader(file);
  while (reader.left() > 0) {
    const char c = char(*reader.take(1));
    if (!std::isspace(static_cast<unsigned char>(c))) return c;
  }
  return 0;
}

ColmapModel sorted_by_name(ColmapModel model) {
  std::sort(model.images.begin(), model.images.end(),
            [](const ColmapImage& a, const ColmapImage& b) { return a.name < b.name; });
  return model;
}

/// The model that a folder is or holds; nothing where it does not.
std::optional<ColmapModel> find_model(const fs::path& folder) {
  const fs::path place = is_colmap_model(folder) ? folder : find_colmap_model(folder);
  if (!place.empty()) return sorted_by_name(read_colmap_model(place));
  if (has_transforms(folder)) return read_transforms(folder).model;
  return std::nullopt;
}

Camera single_precision_camera(PinholeCamera<double> camera, const ColmapImage& image,
                               const fs::path& path) {
  camera.cam_from_world_rotation = rotation_matrix(image.cam_from_world_rotation);
  camera.cam_from_world_translation = image.cam_from_world_translation;
  camera.time = image.time;
  const Camera result = camera_as<float>(camera);
  if (!is_finite(result.position()))
    cannot_read(path, fmt::format("the pose of {} does not fit single precision; leave it out",
                                  image.name));
  return result;
}

std::vector<NamedCamera> cameras_of(ColmapModel model, const fs::path& path,
                                    const Vec3d& world_offset) {
  split_panoramas(model);
  std::vector<Vec3d> positions;
  for (const ColmapImage& image : model.images) positions.push_back(center_of(image));
  if (are_nearer_to(world_offset, positions)) take_off(model, world_offset);
  std::map<std::pair<std::uint32_t, bool>, PinholeCamera<double>> trained;  // one search each
  std::vector<NamedCamera> cameras;
  for (const ColmapImage& image : model.images) {
    const bool moves = image.motion.is_any();
    const auto [found, is_new] = trained.try_emplace({image.camera_id, moves});
    if (is_new)
      found->second = (moves ? row_by_row_camera : trained_camera)(
          lens_camera(model.cameras.at(image.camera_id), image.name), LensUse::automatic,
          image.name);
    const auto camera = moves ? with_motion(found->second, image.motion) : found->second;
    cameras.push_back({image.name, single_precision_camera(camera, image, path)});
  }
  return cameras;
}

}  // namespace

std::vector<NamedCamera> read_cameras(const fs::path& path, const Vec3d& world_offset) {
  std::vector<NamedCamera> cameras;
  if (!fs::is_directory(path)) {
    cameras = first_character(path) == '{'
                  ? cameras_of(read_transforms_file(path), path, world_offset)
                  : read_cameras_json(path, world_offset);
  } else if (fs::exists(path / "cameras.json")) {
    return read_cameras(path / "cameras.json", world_offset);
  } else {
    std::optional<ColmapModel> model = find_model(path);
    if (!model)
      throw Error(fmt::format(
          "there are no cameras in {}: neither a COLMAP model (cameras and images, .bin or .txt) "
          "nor transforms.json nor cameras.json; name a folder that holds one, or the file",
          path.string()));
    cameras = cameras_of(std::move(*model), path, world_offset);
  }
  if (cameras.empty()) cannot_read(path, "it holds no camera; name another");
  return cameras;
}

}  // namespace gs
