// SPDX-License-Identifier: Apache-2.0
// What to say before photos are read that are larger than training needs them.
#pragma once

#include <string>

#include "data_loaders/photos/photos.h"

namespace gs {

/// A sentence with the remedy where photos of this size train at more than 6 million pixels; else
/// empty. `resolution` is dataset.resolution, and `largest` the size of the largest photo.
std::string advice_on_large_photos(const PhotoSize& largest, int resolution);

}  // namespace gs
