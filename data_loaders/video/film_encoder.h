// SPDX-License-Identifier: Apache-2.0
// The part of a FilmWriter that needs OpenCV's videoio.
#pragma once

#include <filesystem>
#include <memory>

#include "gs_core/image.h"

namespace gs {

/// Encodes frames into one MP4 file. Order of calls: open(), write() for each frame, close().
class FilmEncoder {
 public:
  virtual ~FilmEncoder() = default;
  /// `four_letters` names the codec as OpenCV does ("avc1"). False where there is no such encoder.
  virtual bool open(const std::filesystem::path& film, const char* four_letters, int width,
                    int height, double frames_per_second) = 0;
  /// A frame of 1 or 3 channels, display sRGB. The encoder does not report a full disk.
  virtual void write(const Image8& frame) = 0;
  virtual void close() = 0;
};

/// Null in a build without OpenCV's videoio.
std::unique_ptr<FilmEncoder> make_film_encoder();

}  // namespace gs
