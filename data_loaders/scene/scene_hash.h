// SPDX-License-Identifier: Apache-2.0
// Which scene a run has seen, in sixteen letters.
#pragma once

#include <string>

#include "gs_core/config/config.h"

namespace gs {

/// Sixteen hexadecimal digits: FNV-1a (64 bits) over the names and sizes of all pictures in the photos' folder, in byte
/// order, and over the bytes of the camera model's files. Photos are not read: one that changes and keeps its size is
/// not noticed. The same wherever the scene lies. Throws Error where there is no scene.
std::string scene_hash(const DatasetConfig& dataset);

}  // namespace gs
