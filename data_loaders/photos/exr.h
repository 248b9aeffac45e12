// SPDX-License-Identifier: Apache-2.0
// Pictures of measured values, exact to the last bit: OpenEXR with 32-bit floats. Needs OpenImageIO; a build without it says so.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/image.h"

namespace gs {

bool can_write_exr();
/// What a build that cannot says, and what to do.
std::string cannot_write_exr();

/// Writes the values as they are, compressed without loss; `channels` names them ("R", "G", "B"; "Z"). The file is there
/// whole or not at all. Throws Error where it cannot be written, and in a build without OpenImageIO.
void write_exr(const std::filesystem::path& path, const ImageF& image,
               const std::vector<std::string>& channels);

/// A picture of floats with its channels in the order that the file gives them. `channels`, where it is not null, becomes
/// their names. Throws Error for a file that is missing, damaged or of no such kind, and in a build without OpenImageIO.
ImageF read_exr(const std::filesystem::path& path, std::vector<std::string>* channels = nullptr);

}  // namespace gs
