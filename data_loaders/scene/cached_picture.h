// SPDX-License-Identifier: Apache-2.0
// Pictures of views by way of a cache on disk (photo_cache.h): a detour of view_picture.h.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "data_loaders/photos/photo_cache.h"
#include "data_loaders/scene/view_picture.h"
#include "gs_core/config/config.h"

namespace gs {

/// The pictures of one scene. Calls for different views may come from several threads at once.
class CachedPictures {
 public:
  CachedPictures(const std::filesystem::path& folder, std::uint64_t most_bytes, std::size_t views)
      : cache_(folder, most_bytes), keys_(views) {}

  /// make_picture() from the cache, which is given the pictures that it lacks.
  Picture picture(std::size_t view, const Photo& photo);

  /// The parts of picture(), for pictures that somebody else makes. has() tells whether the cache
  /// seems to hold the picture; store() comes after has() or find(), and does nothing if the files
  /// were changed since then.
  bool has(std::size_t view, const Photo& photo);
  std::optional<Picture> find(std::size_t view, const Photo& photo);
  void store(std::size_t view, const Photo& photo, const Picture& picture);

  const std::filesystem::path& folder() const { return cache_.folder(); }

 private:
  /// The name of a picture in the cache, and the state of its files when the name was found.
  struct Key {
    std::string name;
    std::uintmax_t bytes = 0;
    std::filesystem::file_time_type changed;
  };
  const std::string& key_of(std::size_t view, const Photo& photo);
  std::string key_of_frame(const Photo& photo, const Key& file);

  PhotoCache cache_;
  std::vector<Key> keys_;  // of each view
  std::mutex mutex_;
  std::map<std::filesystem::path, Key> videos_;  // their bytes are hashed once
};

/// The cache of dataset.photo_cache, or null if it would save no work: photos that are neither
/// undistorted nor resized are only worth it if they are decoded again and again (not `all_fit`).
/// Frames of videos are always worth it then.
std::shared_ptr<CachedPictures> cache_for(const DatasetConfig& dataset,
                                          const std::vector<Photo>& photos, bool all_fit);

}  // namespace gs
