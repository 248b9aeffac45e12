// SPDX-License-Identifier: Apache-2.0
// Decodes videos: all frames in order, or the sharpest of each of many short stretches as photos.
// Needs OpenCV; film_frames.h does not.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "gs_core/image.h"

namespace gs {

/// Whether this build reads videos.
bool can_read_videos();

/// What decodes videos: its name and version.
std::string video_codec_name();

/// Reads a video from its beginning. Order of calls: next(), picture(), next(), ... A rotation stored
/// in the file (phones held upright) is applied. One thread at a time. The same file always gives
/// the same pictures. Throws Error for frames that cannot be decoded.
class VideoReader {
 public:
  virtual ~VideoReader() = default;
  /// Goes on to the next frame, the first one at first; false at the end of the video.
  virtual bool next() = 0;
  /// The present frame, (height, width, 3).
  virtual Image8 picture() = 0;
};

/// Throws Error if the video cannot be read.
std::unique_ptr<VideoReader> open_video(const std::filesystem::path& video);

/// The number of frames from the file's header, or else counted. Throws Error if the video cannot
/// be read.
std::int64_t count_frames(const std::filesystem::path& video);

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
