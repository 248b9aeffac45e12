// SPDX-License-Identifier: Apache-2.0
// Decodes the frames of videos in order. Needs OpenCV; film_frames.h does not.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "gs_core/error.h"
#include "gs_core/image.h"

namespace gs {

/// Throws Error: cannot read video FILE: `what`.
[[noreturn]] inline void cannot_read_video(const std::filesystem::path& video,
                                           const std::string& what) {
  throw Error(
      "cannot read video " + video.string() + ": " + what +
      "; copy it again, or convert it with ffmpeg -i VIDEO -c:v libx264 -crf 16 NEW.mp4 and "
      "name NEW.mp4");
}

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

}  // namespace gs
