// SPDX-License-Identifier: Apache-2.0
// The files that other programs make for photos, such as masks and depth maps: which one belongs to
// which photo.
#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace gs {

/// The pictures of a folder with one file for each photo. For a photo a/b.jpg and the kind "mask"
/// that is, in this order: a/b.jpg.png, a/b.jpg, a/b.png, a/b.mask.png, a/b.jpg.mask.png,
/// a/b_mask.png, a/b.jpg_mask.png; any other ending of pictures does as well as .png.
class FilesOfPhotos {
 public:
  /// kind    as in errors and at the end of names: "mask", "depth"
  /// images  the photos' folder; where it is `folder` itself, its photos do not count. Both
  ///         `photo_names` and the strings outlive this.
  FilesOfPhotos(std::string kind, std::filesystem::path folder, const std::filesystem::path& images,
                const std::set<std::string>& photo_names);

  std::size_t count() const { return names_.size(); }

  /// The file of the photo of that name, relative to the folder; empty if there is none. Throws
  /// Error where there are two.
  std::string of(const std::string& photo) const;

 private:
  std::string one_of(const std::string& stem, const std::string& photo, bool spare_others) const;

  std::string kind_;
  std::filesystem::path folder_;
  const std::set<std::string>& photo_names_;
  std::set<std::string> names_;
  std::map<std::string, std::vector<std::string>> by_stem_;
};

}  // namespace gs
