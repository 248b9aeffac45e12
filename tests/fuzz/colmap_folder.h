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

/// The search for undistorted pictures takes 60 microseconds here for each pixel of a border, of at
/// most 16,384 on a side. One large camera passes, and no dozens of them.
inline bool are_searched_fast(const ColmapModel& model) {
  int border = 0;
  for (const auto& [id, camera] : model.cameras)
    border += std::min(camera.width, 16384) + std::min(camera.height, 16384);
  return border < 20'000;
}

inline void read_colmap_folder(const std::filesystem::path& folder) {
  bool is_fast = true;
  takes([&] {
    ColmapModel model = read_colmap_model(folder, Tracks::read);
    is_fast = are_searched_fast(model);
    take_off(model, world_offset_of(model));
    std::sort(model.images.begin(), model.images.end(),
              [](const ColmapImage& a, const ColmapImage& b) { return a.name < b.name; });
    DatasetConfig dataset;
    dataset.eval = true;
    test_views_of(dataset, model);
  });
  if (is_fast) takes([&] { read_cameras(folder, Vec3d(0.0)); });
  takes([&] { count_colmap_images(folder); });
}

}  // namespace gs::fuzz
