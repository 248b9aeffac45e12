// SPDX-License-Identifier: Apache-2.0
// Frames of videos by their numbers. A frame can only be decoded after those before it, because
// seeking is not exact in every format.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <vector>

#include "gs_core/image.h"

namespace gs {

/// Whether a file is a video, by its ending in upper or lower case.
bool is_video(const std::filesystem::path& file);

/// A single frame, counted from 0. All frames before it are decoded, too. Throws Error if the video
/// cannot be read or ends before it.
Image8 read_frame(const std::filesystem::path& video, std::int64_t number);

struct VideoFrame {
  std::filesystem::path video;
  std::int64_t number = 0;  // from 0
};

/// Calls take(i, picture) with the picture of each of the frames for which wants(i) is true. Each
/// video is decoded once, from its beginning to the last frame that is wanted, and up to
/// `most_at_once` (> 0) videos are at a time, by threads that call both functions. Throws Error like
/// read_frame().
void for_each_frame(const std::vector<VideoFrame>& frames, std::size_t most_at_once,
                    const std::function<bool(std::size_t i)>& wants,
                    const std::function<void(std::size_t i, Image8 picture)>& take);

}  // namespace gs
