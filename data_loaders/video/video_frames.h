// SPDX-License-Identifier: Apache-2.0
// From a video to photos: the sharpest frame of each of many short stretches. Needs OpenCV; a build without it says so.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace gs {

/// Whether this build reads videos.
bool can_read_videos();

/// The number of frames, as the file states it or else counted. Throws Error where the video cannot be read.
std::int64_t count_frames(const std::filesystem::path& video);

/// Called after each frame that was looked at.
using FrameProgress = std::function<void(std::int64_t done)>;

/// Cuts the video's `total` frames into `wanted` stretches of one length (all frames, if there are no more) and writes the
/// frame of each with the largest variance of the Laplacian, the first among equals, to FOLDER/STEM_NNNNNN.png, NNNNNN
/// being its number from 0: names sort by time. A turn that the file asks for (phones held upright) is followed.
/// Returns the names. The same call writes the same files. Warns where the video ends early; throws Error where it
/// cannot be read at all.
std::vector<std::string> take_frames(const std::filesystem::path& video, std::int64_t total,
                                     std::int64_t wanted, const std::filesystem::path& folder,
                                     const std::string& stem, const FrameProgress& progress);

}  // namespace gs
