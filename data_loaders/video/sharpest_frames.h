// SPDX-License-Identifier: Apache-2.0
// The sharpest frames of a video as photos for COLMAP.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace gs {

/// Called after each frame.
using FrameProgress = std::function<void(std::int64_t done)>;

/// Cuts the video's `total` frames into `wanted` stretches of equal length (single frames if there
/// are no more) and writes the sharpest frame of each to FOLDER/STEM_NNNNNN.png. Sharpness is the
/// variance of the Laplacian; among equals the first frame counts. NNNNNN is the frame's number
/// from 0, so names sort by time. A rotation stored in the file (phones held upright) is applied.
/// Returns the names. The same call writes the same files. Warns if the video ends early; throws
/// Error if it cannot be read at all.
std::vector<std::string> take_frames(const std::filesystem::path& video, std::int64_t total,
                                     std::int64_t wanted, const std::filesystem::path& folder,
                                     const std::string& stem, const FrameProgress& progress);

}  // namespace gs
