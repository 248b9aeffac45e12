// SPDX-License-Identifier: Apache-2.0
// Writes the pictures of `gemsplat render`: files in a folder, or a film for each quantity.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "data_loaders/video/film_writer.h"
#include "gs_app/export/view_pictures.h"
#include "gs_core/system/files/output_lock.h"

namespace gs {

struct OutputRequest {
  std::filesystem::path output;      // a folder, or a file that ends in .mp4
  std::vector<Quantity> quantities;  // none twice
  bool png = true, exr = false;      // of a folder
  double frames_per_second = 30;     // of a film
  bool is_panorama = false;          // of 360 degrees, which files say
  bool force = false;                // move files that are in the way to FILE.bak-N

  bool is_film() const;
  /// True where pictures of 8 bits of the color alone are asked for.
  bool is_color_in_8_bits() const;
};

/// Throws UsageError for a request that contradicts itself, and Error for one that this build
/// cannot fulfil. Call it before the work starts.
void check_output(const OutputRequest& request);

/// Writes what was rendered, and holds the output's lock. Order of calls: construct, write() for
/// each view in order, finish(). Pictures wait until there is one for each thread; write_waiting()
/// keeps those of a job that ends early.
class RenderOutput {
 public:
  /// `names` are the names of the views. Throws UsageError where a file is there already and may
  /// not be moved aside, and where two views would have the same file.
  RenderOutput(OutputRequest request, std::vector<std::string> names, const DepthRange& range);

  /// Writes a quantity of view `i`. All views of a film have the same size, with even sides. An
  /// older file is moved to FILE.bak-N.
  void write(std::size_t i, Quantity quantity, const ImageF& values);
  /// The same where it is a picture already: of a film, or of files of 8 bits.
  void write(std::size_t i, Quantity quantity, Image8 shown);
  /// Writes the pictures that wait, side by side.
  void write_waiting();
  /// Writes them, completes the films and gives these their names.
  void finish();

  /// A file that goes with the pictures: FILM.json beside FILM.mp4, FOLDER/film.json.
  std::filesystem::path description() const;
  /// FILM.cameras.json, FOLDER/cameras.json.
  std::filesystem::path cameras() const;
  /// For each quantity, by name: the film's file, or "{name}.depth.png", where {name} is the
  /// view's.
  std::map<std::string, std::vector<std::string>> patterns() const;
  /// "H.264", or "MPEG-4"; empty where there is no film.
  const std::string& codec() const { return codec_; }

 private:
  std::filesystem::path film(Quantity quantity) const;
  std::filesystem::path picture(std::size_t i, Quantity quantity, const char* extension) const;
  std::string suffix(Quantity quantity) const;
  std::vector<const char*> extensions() const;
  void write_frame(Quantity quantity, const Image8& frame);
  void move_older_aside(const std::filesystem::path& file);
  void add(std::filesystem::path file, std::size_t bytes,
           std::function<void(const std::filesystem::path&)> write);

  // A file that waits to be written.
  struct Waiting {
    std::filesystem::path file;
    std::function<void(const std::filesystem::path&)> write;
  };

  OutputRequest request_;
  OutputLock lock_;
  std::vector<std::string> names_;
  DepthRange range_;
  std::map<Quantity, FilmWriter> films_;
  std::string codec_;
  std::vector<Waiting> waiting_;
  std::size_t waiting_bytes_ = 0;
  std::atomic<std::size_t> moved_aside_ = 0;
};

}  // namespace gs
