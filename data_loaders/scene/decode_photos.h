// SPDX-License-Identifier: Apache-2.0
// From planned photos to views: decoded at once where they fit into memory, else by a PhotoPool just
// before their turn.
#pragma once

#include <vector>

#include "data_loaders/scene/load_scene.h"
#include "data_loaders/scene/photo.h"

namespace gs {

/// Views with their photos, or with a pool if they do not fit into dataset.photo_ram_gib or were
/// only asked for. Throws Error that names the photo, UsageError if the memory is too small for
/// one.
std::vector<View> decode_photos(const DatasetConfig& dataset, std::vector<Photo> photos,
                                const LoadProgress& progress, PhotoLoading loading);

}  // namespace gs
