// SPDX-License-Identifier: Apache-2.0
// Tells players that a film is a panorama of 360 degrees.
#pragma once

#include <filesystem>

namespace gs {

/// Adds the box of Google's Spherical Video V1 to the first track of an MP4 whose index (`moov`)
/// follows its frames, as ffmpeg writes it. False, and nothing changed, where it does not. Throws
/// Error if the file cannot be read or written.
bool mark_as_panorama(const std::filesystem::path& film);

}  // namespace gs
