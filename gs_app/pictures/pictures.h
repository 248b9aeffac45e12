// SPDX-License-Identifier: Apache-2.0
// Small matters of pictures that several verbs share.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/image.h"

namespace gs {

/// `wanted` (or all, where there are fewer) indices below `count`, evenly spread, ascending.
std::vector<std::size_t> evenly_chosen(std::size_t count, std::size_t wanted);

/// "00012.png": picture 12 of an evaluation.
std::string picture_file(std::size_t index);

/// Where the picture of a view goes: its name under `folder`, with .png for a photo's extension. A name that would
/// leave the folder keeps its last part only.
std::filesystem::path picture_path(const std::filesystem::path& folder,
                                   const std::string& view_name);

}  // namespace gs
