// SPDX-License-Identifier: Apache-2.0
// Helpers for pictures that several parts of the program share: which ones to choose
// (evenly_chosen.h), and the names of their files.
#pragma once

#include <filesystem>
#include <string>

#include "gs_core/evenly_chosen.h"
#include "gs_core/image.h"

namespace gs {

/// The file of a picture of an evaluation: "00012.png" for index 12.
std::string picture_file(std::size_t index);

/// The file of a view's picture: its name under `folder`, with .png instead of the photo's
/// extension. Of a name that would lead out of the folder only the last part is used.
std::filesystem::path picture_path(const std::filesystem::path& folder,
                                   const std::string& view_name);

}  // namespace gs
