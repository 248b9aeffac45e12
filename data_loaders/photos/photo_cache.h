// SPDX-License-Identifier: Apache-2.0
// Decoded, undistorted and resized photos on disk, so that the next epoch, or the next run, need
// not make them again.
#pragma once

#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "gs_core/image.h"

namespace gs {

/// Whether this build has zstd and xxhash. Without them no cache holds or takes anything.
bool can_cache_photos();

/// A folder of entries FOLDER/ab/abcdef....gsphoto. An entry is written whole or not at all. It has
/// its key and a checksum, and a damaged entry, or one of another key, counts as missing. Several programs may use a folder at once.
///
/// Rows are stored as differences to the pixel on the left, compressed with zstd at level 1. A
/// photo of 1 to 1.1 megapixels shrinks to 46 to 64 % of its bytes and is read in 3 ms on one core.
/// A PNG (level 1) takes as many bytes and 16 to 26 ms. The original JPEG takes 6 to 9 ms, and has
/// to be undistorted and resized.
class PhotoCache {
 public:
  /// Creates no file yet. All entries together stay below `most_bytes`.
  PhotoCache(std::filesystem::path folder, std::uint64_t most_bytes);

  /// The key of an entry made from a file: a hash (128 bits) of the file's bytes and of `recipe`,
  /// a text with every other input. Up to 8 small letters may be added, for pictures of several
  /// kinds. Throws Error if the file cannot be read.
  static std::string key_of(const std::filesystem::path& file, const std::string& recipe);

  /// The key of an entry that `text` describes whole, such as the key of a file and a part of it.
  static std::string key_of_text(const std::string& text);

  /// Whether there is an entry of this key, which may be damaged. It counts as used.
  bool has(const std::string& key);
  /// The entry, if it exists, is undamaged and has this size. A damaged one is removed.
  std::optional<Image8> find(const std::string& key, int width, int height, int channels);
  /// Adds an entry. If it does not fit, the entries used longest ago are removed first, but none
  /// that was used since this cache was opened; if that is not enough, nothing is added. The first
  /// failure of the disk gives a warning and ends storing.
  void store(const std::string& key, const Image8& image);

  const std::filesystem::path& folder() const { return folder_; }

 private:
  struct OldEntry {
    std::filesystem::path path;
    std::filesystem::file_time_type used;
    std::uint64_t bytes;
  };
  std::filesystem::path path_of(const std::string& key) const;
  void take_stock();
  bool free_bytes_for(std::uint64_t bytes);
  void write(const std::string& key, const Image8& image);

  const std::filesystem::path folder_;
  const std::uint64_t most_bytes_;
  const std::filesystem::file_time_type opened_;
  std::mutex mutex_;
  bool has_taken_stock_ = false, is_closed_ = false;
  std::uint64_t bytes_ = 0;          // of all entries
  std::vector<OldEntry> removable_;  // the one used longest ago is last
};

/// The program's cache: gemsplat/photos in $XDG_CACHE_HOME or ~/.cache; empty if there is neither.
std::filesystem::path usual_photo_cache();

}  // namespace gs
