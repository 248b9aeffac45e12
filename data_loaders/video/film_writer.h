// SPDX-License-Identifier: Apache-2.0
// Writes a film frame by frame into an MP4. Needs OpenCV with its module videoio.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "gs_core/image.h"

namespace gs {

class FilmEncoder;

bool can_write_films();
/// The message of a build without videoio, with the remedy.
std::string cannot_write_films();

/// One film in the making. Order of calls: construct, write() for each frame, commit(). The frames
/// go to a temporary file beside `path`. Without commit() nothing is left of it, and an older file
/// of that name is untouched.
class FilmWriter {
 public:
  /// Writes H.264 in 4:2:0, which browsers play, if this machine's OpenCV and ffmpeg have an
  /// encoder for it, at OpenCV's constant quality (x264's CRF 23 in 4.6). Otherwise writes MPEG-4
  /// Part 2 and warns. `width` and `height` are even. Throws Error if the file cannot be written or
  /// there is no encoder.
  FilmWriter(std::filesystem::path path, int width, int height, double frames_per_second);
  ~FilmWriter();
  FilmWriter(FilmWriter&&) noexcept;
  FilmWriter& operator=(FilmWriter&&) = delete;

  /// A frame of the film's size with 1 or 3 channels, display sRGB.
  void write(const Image8& frame);
  /// Ends the film, checks that all frames are in it, tells players if it `is_panorama`, and gives
  /// it its name. Throws Error if some are missing.
  void commit(bool is_panorama = false);
  /// "H.264" or "MPEG-4".
  const std::string& codec() const { return codec_; }

 private:
  std::filesystem::path path_, temporary_;
  [[maybe_unused]] int width_, height_;  // in builds without OpenCV
  [[maybe_unused]] std::int64_t frames_ = 0;
  std::string codec_;
  std::unique_ptr<FilmEncoder> encoder_;
};

}  // namespace gs
