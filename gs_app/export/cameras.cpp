// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/cameras.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "data_loaders/cameras/read_cameras.h"
#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/scene/load_scene.h"

namespace gs {

std::vector<NamedCamera> cameras_of_file(const std::filesystem::path& file, int resolution,
                                         const Vec3d& world_offset) {
  std::vector<NamedCamera> cameras = read_cameras(file, world_offset);
  for (NamedCamera& named : cameras) named.camera = at_resolution(named.camera, resolution);
  return cameras;
}

std::vector<NamedCamera> cameras_of_run(const RunFolder& run, int resolution,
                                        const std::string& split, const Vec3d& world_offset) {
  std::vector<NamedCamera> cameras = cameras_of_file(run.cameras(), resolution, world_offset);
  // The file has the test views first; films and paths go in the order of names.
  std::sort(cameras.begin(), cameras.end(),
            [](const NamedCamera& a, const NamedCamera& b) { return a.name < b.name; });
  if (split == "all") return cameras;
  std::set<std::string> wanted;  // names as in cameras.json
  for (const std::string& name : split_names(run, split)) wanted.insert(without_extension(name));
  std::erase_if(cameras, [&](const NamedCamera& named) { return !wanted.contains(named.name); });
  return cameras;
}

std::vector<NamedCamera> cameras_of_scene(DatasetConfig dataset, const std::string& split,
                                          const Vec3d& world_offset) {
  dataset.eval = split != "all";
  dataset.exposure = false;  // pictures show the scene's own colors
  dataset.masks = dataset.depth = "none";
  Scene scene = load_scene(dataset, {}, PhotoLoading::when_asked);  // nobody asks for a photo
  bring_to_offset(scene, world_offset);
  std::vector<NamedCamera> cameras;
  for (const View& view : split == "test" ? scene.test_views : scene.train_views)
    cameras.push_back({view.name, view.camera});
  return cameras;
}

Camera reframed(Camera camera, int width, int height) {
  const float scale =
      std::min(float(width) / float(camera.width), float(height) / float(camera.height));
  const auto center = [&](float c, int from, int to) {
    return 0.5f * float(to) + scale * (c - 0.5f * float(from));
  };
  camera.cx = center(camera.cx, camera.width, width);
  camera.cy = center(camera.cy, camera.height, height);
  camera.fx *= scale;
  camera.fy *= scale;
  camera.width = width;
  camera.height = height;
  return camera;
}

Camera with_field_of_view(Camera camera, double degrees) {
  const double half = 0.5 * degrees * std::numbers::pi / 180;
  camera = without_lens(camera);
  camera.fx = camera.fy = float(0.5 * camera.width / std::tan(half));
  camera.cx = 0.5f * float(camera.width);
  camera.cy = 0.5f * float(camera.height);
  return camera;
}

}  // namespace gs
