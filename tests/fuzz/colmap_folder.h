// SPDX-License-Identifier: Apache-2.0
// All that is read from a folder with a COLMAP model before a photo is opened.
#pragma once

#include <algorithm>

#include "data_loaders/cameras/read_cameras.h"
#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/scene/scene_model.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {

// The search for the undistorted picture takes up to a second here, for each camera.
inline constexpr std::size_t kMostCameras = 3;

inline void read_colmap_folder(const std::filesystem::path& folder) {
  std::size_t cameras = 0;
  takes([&] {
    ColmapModel model = read_colmap_model(folder, Tracks::read);
    cameras = model.cameras.size();
    take_off(model, world_offset_of(model));
    std::sort(model.images.begin(), model.images.end(),
              [](const ColmapImage& a, const ColmapImage& b) { return a.name < b.name; });
    DatasetConfig dataset;
    dataset.eval = true;
    test_views_of(dataset, model);
  });
  if (cameras <= kMostCameras) takes([&] { read_cameras(folder, Vec3d(0.0)); });
  takes([&] { count_colmap_images(folder); });
}

}  // namespace gs::fuzz
