// SPDX-License-Identifier: Apache-2.0
#include "cli/cameras.h"

#include <set>

#include "data_loaders/load_scene.h"
#include "data_loaders/photos.h"
#include "data_loaders/world_offset.h"

namespace gs {

std::vector<NamedCamera> cameras_of_file(const std::filesystem::path& file, int resolution,
                                         const Vec3d& world_offset) {
  std::vector<NamedCamera> cameras = read_cameras_json(file, world_offset);
  for (NamedCamera& named : cameras) named.camera = at_resolution(named.camera, resolution);
  return cameras;
}

std::vector<NamedCamera> cameras_of_run(const RunFolder& run, int resolution,
                                        const std::string& split, const Vec3d& world_offset) {
  std::vector<NamedCamera> cameras = cameras_of_file(run.cameras(), resolution, world_offset);
  if (split == "all") return cameras;
  std::set<std::string> wanted;  // names as in cameras.json
  for (const std::string& name : split_names(run, split))
    wanted.insert(std::filesystem::path(name).replace_extension().generic_string());
  std::erase_if(cameras, [&](const NamedCamera& named) { return !wanted.contains(named.name); });
  return cameras;
}

std::vector<NamedCamera> cameras_of_scene(DatasetConfig dataset, const std::string& split,
                                          const Vec3d& world_offset) {
  dataset.eval = split != "all";
  dataset.exposure = false;  // pictures show the scene's own colours
  Scene scene = load_scene(dataset);
  bring_to_offset(scene, world_offset);
  std::vector<NamedCamera> cameras;
  for (const View& view : split == "test" ? scene.test_views : scene.train_views)
    cameras.push_back({view.name, view.camera});
  return cameras;
}

}  // namespace gs
