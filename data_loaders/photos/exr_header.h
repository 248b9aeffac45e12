// SPDX-License-Identifier: Apache-2.0
// The header of an EXR.
#pragma once

#include "data_loaders/photos/picture_bytes.h"
#include "data_loaders/photos/picture_header.h"

namespace gs {

/// Takes the size of an EXR and its bytes per pixel from the attributes of its parts, and marks the
/// header as damaged where an attribute has another length than its type.
void read_exr_header(const PictureFile& file, PictureHeader& header);

}  // namespace gs
