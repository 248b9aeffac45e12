// SPDX-License-Identifier: Apache-2.0
// A fingerprint of a scene, to tell whether two runs were trained on the same one.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "gs_core/config/config.h"

namespace gs {

/// Sixteen hexadecimal digits: FNV-1a (64 bits) over the names and sizes of all pictures in the
/// photos' folder, in byte order, with dataset.times = "frames" also of its videos, and over the bytes of the camera model's files. Photos are not
/// read, so a changed photo of the same size goes unnoticed. The scene's place on the disk does not
/// matter. Throws Error if there is no scene.
std::string scene_hash(const DatasetConfig& dataset);

/// For each name of a photo, relative to the photos' folder, a hash of its file: of its size and of
/// its first, middle and last 16 KiB, so that replaced photos are noticed without reading all of
/// them. A frame of a video has the hash of the video. Never 0, except for files that cannot be read.
std::vector<std::uint64_t> photo_hashes(const DatasetConfig& dataset,
                                        const std::vector<std::string>& names);

}  // namespace gs
