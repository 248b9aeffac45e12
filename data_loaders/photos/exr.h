// SPDX-License-Identifier: Apache-2.0
// Pictures of measured values, exact to the last bit: OpenEXR with 32-bit floats. Needs
// OpenImageIO.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/image.h"

namespace gs {

bool can_write_exr();
/// The message of a build without OpenImageIO, with the remedy.
std::string cannot_write_exr();

/// Writes the values as they are, compressed without loss. `channels` are their names, for example
/// "R", "G", "B" or "Z". The file exists whole or not at all. Throws Error if it cannot be written,
/// and in a build without OpenImageIO.
void write_exr(const std::filesystem::path& path, const ImageF& image,
               const std::vector<std::string>& channels);

/// Reads a picture of floats with its channels in the file's order. `channels`, unless null,
/// receives their names. Throws Error if the file is missing, damaged or not EXR, and in a build
/// without OpenImageIO.
ImageF read_exr(const std::filesystem::path& path, std::vector<std::string>* channels = nullptr);

}  // namespace gs
