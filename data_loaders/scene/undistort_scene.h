// SPDX-License-Identifier: Apache-2.0
// `gemsplat undistort`: a copy of a scene without lenses, for builds and programs that train on
// pinhole cameras only.
#pragma once

#include <filesystem>

#include "data_loaders/scene/load_scene.h"

namespace gs {

/// What undistort_scene() has written.
struct UndistortedScene {
  std::size_t undistorted = 0, copied = 0;  // photos
  std::size_t masks = 0, depth_maps = 0;
  double jpeg_psnr = 0;  // dB, mean over the JPEGs, against the undistorted pixels; 0 for PNG
  bool needs_background = false;  // the copy needs dataset.mask_mode = "background"
};

/// Writes images/, masks/ and depth/ (if there are any) and sparse/0 with PINHOLE cameras to `out`.
/// Loading `out` gives the views of the scene: the same pixels from PNG files, at every
/// dataset.resolution, and nearly the same from JPEG files. Photos without a lens are copied, masks
/// become PNG files of the photos' size, depth maps EXR files in world units (where the build can
/// write them), and poses, points, tracks, rigs and frames stay. Photos keep their names except for
/// the ending. `jpeg_quality`: 1 to 100, or 0 for PNG.
///
/// Throws UsageError if `out` exists and is not empty; Error if the scene cannot be loaded or a
/// file cannot be written.
UndistortedScene undistort_scene(const DatasetConfig& dataset, const std::filesystem::path& out,
                                 int jpeg_quality, const ProgressFn& progress = {});

}  // namespace gs
