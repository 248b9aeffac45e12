// SPDX-License-Identifier: Apache-2.0
// A film, frame by frame into an MP4. Needs OpenCV with its videoio module; a build without it says so.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "gs_core/image.h"

namespace gs {

class FilmEncoder;

bool can_write_films();
/// What a build that cannot says, and what to do.
std::string cannot_write_films();

/// One film in the making. Order of calls: construct, write() for each frame, commit(). The frames go to a temporary file
/// beside `path`; without commit() nothing is left of it, and an older file of that name is untouched.
class FilmWriter {
 public:
  /// H.264 in 4:2:0, which browsers play, where this machine's OpenCV and ffmpeg have an encoder for it, at the constant
  /// quality that OpenCV asks for (x264's CRF 23 in 4.6); else MPEG-4 Part 2, with a warning.
  /// `width` and `height` are even. Throws Error where the file cannot be written or no encoder is there.
  FilmWriter(std::filesystem::path path, int width, int height, double frames_per_second);
  ~FilmWriter();
  FilmWriter(FilmWriter&&) noexcept;
  FilmWriter& operator=(FilmWriter&&) = delete;

  /// A frame of the film's size with 1 or 3 channels, display sRGB.
  void write(const Image8& frame);
  /// Ends the film, looks whether all frames are in it, and gives it its name. Throws Error where they are not.
  void commit();
  /// "H.264" or "MPEG-4".
  const std::string& codec() const { return codec_; }

 private:
  std::filesystem::path path_, temporary_;
  int width_, height_;
  std::int64_t frames_ = 0;
  std::string codec_;
  std::unique_ptr<FilmEncoder> encoder_;
};

}  // namespace gs
