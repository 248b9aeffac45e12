// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/masks.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <set>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/photos/photo_fit.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/scene/transforms_json.h"
#include "gs_core/error.h"
#include "gs_core/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr const char* kDefaultFolder = "masks";
constexpr const char* kNone = "none";

bool is_folder(const fs::path& path) {
  std::error_code ignored;
  return fs::is_directory(path, ignored);
}

/// The pictures of the masks' folder, by name and by name without extension.
class MaskFiles {
 public:
  MaskFiles(const MaskSource& source, const std::set<std::string>& photo_names)
      : folder_(source.folder), photo_names_(photo_names) {
    std::error_code ignored;
    const bool has_photos = fs::equivalent(source.folder, source.images, ignored);
    for (std::string& name : picture_names_in(source.folder)) {
      if (has_photos && photo_names.contains(name)) continue;
      by_stem_[without_extension(name)].push_back(name);
      names_.insert(std::move(name));
    }
  }

  std::size_t count() const { return names_.size(); }

  /// The mask of the photo of that name; empty where there is none. See match_masks().
  std::string mask_of(const std::string& photo) const {
    const std::string stem = without_extension(photo);
    std::string found = one_of(photo, photo, false);
    if (found.empty() && names_.contains(photo)) found = photo;
    if (found.empty()) found = one_of(stem, photo, true);
    for (const char* ending : {".mask", "_mask"})
      for (const std::string& begin : {stem, photo})
        if (found.empty()) found = one_of(begin + ending, photo, false);
    return found;
  }

 private:
  // The file with this name but for its extension; without those that other photos are called, where asked for.
  std::string one_of(const std::string& stem, const std::string& photo, bool spare_others) const {
    const auto found = by_stem_.find(stem);
    if (found == by_stem_.end()) return "";
    std::vector<std::string> files = found->second;
    if (spare_others)
      std::erase_if(files, [&](const std::string& file) { return photo_names_.contains(file); });
    if (files.size() > 1) {
      const std::string png = stem + ".png";
      if (std::find(files.begin(), files.end(), png) != files.end()) return png;
      throw Error(fmt::format("photo '{}' could have two masks in {}: {} and {}; leave one there",
                              photo, folder_.string(), files[0], files[1]));
    }
    return files.empty() ? "" : files[0];
  }

  fs::path folder_;
  const std::set<std::string>& photo_names_;
  std::set<std::string> names_;
  std::map<std::string, std::vector<std::string>> by_stem_;
};

/// What is said of a folder in which no photo has a mask.
std::string nothing_matches(const MaskSource& source, std::size_t count,
                            const std::string& first_name) {
  return fmt::format(
      "none of the {} pictures in {} is the mask of a photo: that of {} would be {}.png there, or "
      "{}.png, {}.mask.png, {}_mask.png",
      count, source.folder.string(), first_name, first_name, without_extension(first_name),
      without_extension(first_name), without_extension(first_name));
}

/// One channel of what a mask file holds; see read_mask().
Image8 mask_channel(const fs::path& file) {
  PhotoWithAlpha read = read_photo_with_alpha(file);
  const auto is_below_full = [](std::uint8_t value) { return value < 255; };
  if (std::any_of(read.alpha.pixels.begin(), read.alpha.pixels.end(), is_below_full))
    return std::move(read.alpha);
  Image8 mask(read.photo.width, read.photo.height, 1);
  for (std::size_t i = 0; i < mask.pixels.size(); ++i) {
    const std::uint8_t* pixel = &read.photo.pixels[3 * i];
    mask.pixels[i] = std::max({pixel[0], pixel[1], pixel[2]});
  }
  const std::uint8_t highest = *std::max_element(mask.pixels.begin(), mask.pixels.end());
  if (highest == 1)
    for (std::uint8_t& value : mask.pixels) value = std::uint8_t(255 * value);
  return mask;
}

}  // namespace

MaskSource find_masks(const DatasetConfig& dataset, const SceneFolders& folders) {
  MaskSource source;
  source.images = folders.images;
  source.invert = dataset.invert_masks;
  source.over_background = dataset.mask_mode == MaskMode::background ||
                           (dataset.mask_mode == MaskMode::automatic &&
                            !is_colmap_model(folders.model) && is_blender_scene(folders.model));
  if (dataset.masks == kNone) {
    source.use_alpha = false;
    return source;
  }
  source.is_named = !dataset.masks.empty();
  source.folder =
      fs::path(dataset.source) / (source.is_named ? dataset.masks : std::string(kDefaultFolder));
  if (is_folder(source.folder)) return source;
  if (source.is_named)
    throw Error(
        fmt::format("cannot find the masks of {}: there is no folder {}; name another one "
                    "with --masks, or none of them with --masks none",
                    dataset.source, source.folder.string()));
  source.folder.clear();
  return source;
}

std::vector<fs::path> match_masks(const MaskSource& source, const std::vector<std::string>& names,
                                  const std::vector<fs::path>& photos,
                                  const std::vector<fs::path>& of_model) {
  std::vector<fs::path> masks(names.size());
  if (!source.is_named && source.use_alpha) masks = of_model;
  if (source.folder.empty() || names.empty()) return masks;
  std::vector<std::string> file_names;
  for (const fs::path& photo : photos)
    file_names.push_back(photo.lexically_relative(source.images).generic_string());
  std::set<std::string> photo_names(names.begin(), names.end());
  photo_names.insert(file_names.begin(), file_names.end());
  const MaskFiles files(source, photo_names);
  std::size_t missing = 0;
  std::string first_missing;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (!masks[i].empty()) continue;
    std::string found = files.mask_of(names[i]);
    if (found.empty() && file_names[i] != names[i]) found = files.mask_of(file_names[i]);
    if (!found.empty())
      masks[i] = source.folder / found;
    else if (missing++ == 0)
      first_missing = names[i];
  }
  if (missing == names.size() && source.is_named)
    throw Error(nothing_matches(source, files.count(), names[0]));
  if (missing == names.size())
    log_warning("{}", nothing_matches(source, files.count(), names[0]));
  else if (missing > 0)
    log_warning(
        "{} of {} photos have no mask in {} and train everywhere, but for their alpha: {}{}",
        missing, names.size(), source.folder.string(), first_missing, missing > 1 ? ", ..." : "");
  return masks;
}

void check_mask_size(const fs::path& mask, const fs::path& photo, const PhotoSize& photo_size) {
  const PhotoSize size = read_photo_size(mask);
  if (has_shape_of(size, photo_size)) return;
  throw Error(fmt::format(
      "mask {} has {} x {} pixels and its photo {} has {} x {}: the shapes differ, so the mask was "
      "made for another picture; make it again from this photo, or take it away",
      mask.string(), size.width, size.height, photo.string(), photo_size.width, photo_size.height));
}

Image8 read_mask(const MaskSource& source, const fs::path& file, const PhotoWithAlpha& photo) {
  Image8 mask;
  if (!file.empty()) {
    mask = mask_channel(file);
    if (source.invert)
      for (std::uint8_t& value : mask.pixels) value = std::uint8_t(255 - value);
    mask = area_resized(mask, photo.photo.width, photo.photo.height);
  } else if (source.use_alpha) {
    mask = photo.alpha;
  }
  const bool is_full = std::all_of(mask.pixels.begin(), mask.pixels.end(),
                                   [](std::uint8_t value) { return value == 255; });
  return is_full ? Image8() : mask;
}

void fill_masked_edge(Image8& photo, const Image8& mask, int reach) {
  GS_CHECK(photo.pixels.size() == 3 * mask.pixels.size() && reach < 255);
  std::vector<std::uint8_t> filled_in(mask.pixels.size());  // round, from 1; 0: not yet
  for (std::size_t i = 0; i < filled_in.size(); ++i) filled_in[i] = mask.pixels[i] > 0;
  const auto fill = [&](int x, int y, int round) {
    int sums[3] = {0, 0, 0}, count = 0;
    for (int v = std::max(y - 1, 0); v <= std::min(y + 1, photo.height - 1); ++v)
      for (int u = std::max(x - 1, 0); u <= std::min(x + 1, photo.width - 1); ++u) {
        const int known = filled_in[std::size_t(v) * photo.width + u];
        if (known == 0 || known > round) continue;
        for (int c = 0; c < 3; ++c) sums[c] += photo.at(u, v, c);
        ++count;
      }
    if (count == 0) return;
    for (int c = 0; c < 3; ++c) photo.at(x, y, c) = std::uint8_t((sums[c] + count / 2) / count);
    filled_in[std::size_t(y) * photo.width + x] = std::uint8_t(round + 1);
  };
  for (int round = 1; round <= reach; ++round)
    for (int y = 0; y < photo.height; ++y)
      for (int x = 0; x < photo.width; ++x)
        if (filled_in[std::size_t(y) * photo.width + x] == 0) fill(x, y, round);
}

void multiply_by_mask(Image8& photo, const Image8& mask) {
  GS_CHECK(photo.pixels.size() == 3 * mask.pixels.size());
  for (std::size_t i = 0; i < photo.pixels.size(); ++i)
    photo.pixels[i] = std::uint8_t((photo.pixels[i] * mask.pixels[i / 3] + 127) / 255);
}

void divide_by_mask(Image8& photo, const Image8& mask) {
  GS_CHECK(photo.pixels.size() == 3 * mask.pixels.size());
  for (std::size_t i = 0; i < photo.pixels.size(); ++i) {
    const int m = mask.pixels[i / 3];
    if (m > 0)
      photo.pixels[i] = std::uint8_t(std::min((255 * photo.pixels[i] + m / 2) / m, 255));
    else
      photo.pixels[i] = 0;
  }
}

double trained_share(const Image8& mask) {
  if (mask.empty()) return 1;
  double sum = 0;
  for (const std::uint8_t value : mask.pixels) sum += value;
  return sum / (255.0 * double(mask.pixels.size()));
}

}  // namespace gs
