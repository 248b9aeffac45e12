// SPDX-License-Identifier: Apache-2.0
// What to say of photos that are reduced because they are large.
#pragma once

#include <string>

#include "data_loaders/photos/photos.h"

namespace gs {

/// A sentence for photos that dataset.resolution = 0 has reduced. `largest` is the size of the
/// largest photo, and `reduced` its size in training.
std::string note_on_reduced_photos(const PhotoSize& largest, const PhotoSize& reduced);

}  // namespace gs
