// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/cached_picture.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>

#include "data_loaders/lenses/resample.h"
#include "data_loaders/photos/photo_codec.h"
#include "data_loaders/video/video_frames.h"
#include "gs_core/system/bytes.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// A cache that the user has not named keeps only photos of so many pixels: smaller ones are decoded
// in 10 ms.
constexpr std::int64_t kWorthCaching = std::int64_t(1) << 20;

/// Everything besides the photo's bytes that changes the result of make_picture().
std::string recipe_of(const Photo& photo) {
  std::string text = fmt::format("{} {} {}x{}", kPictureVersion,
                                 photo.is_frame ? video_codec_name() : codec_name(),
                                 photo.target.width, photo.target.height);
  if (!photo.mask_file.empty())
    text += fmt::format(" mask {} {}", photo.masks.invert, PhotoCache::key_of(photo.mask_file, ""));
  else
    text += fmt::format(" alpha {}", photo.masks.use_alpha);
  if (!photo.is_undistorted() && photo.is_explained) return text;
  text += fmt::format(" {} {}", resampler_name(), int(photo.lens.lens));
  const auto add = [&](const auto& numbers) {
    for (const double number : numbers) text += fmt::format(" {:a}", number);
  };
  add(photo.lens.k), add(photo.lens.d), add(photo.lens.p), add(photo.lens.s);
  for (const PinholeCamera<double>* camera : {&photo.lens.pinhole, &photo.undistorted})
    add(std::array<double, 6>{double(camera->width), double(camera->height), camera->fx, camera->fy,
                              camera->cx, camera->cy});
  if (photo.lens.is_hemisphere()) text += photo.is_back ? " back" : " front";
  if (!photo.is_explained) text += fmt::format(" radius {:a}", photo.undistorted.lens.radius);
  return text;
}

// A masked picture is an entry of its own kind, with the mask as a fourth channel.
std::string masked_key(const std::string& key) { return key + "m"; }

}  // namespace

// The content of the files decides. Their sizes and dates only tell whether to read them again.
const std::string& CachedPictures::key_of(std::size_t view, const Photo& photo) {
  std::error_code error;
  const Key file{"", fs::file_size(photo.file, error), fs::last_write_time(photo.file, error)};
  Key now = file;
  Key& known = keys_.at(view);
  if (!photo.mask_file.empty()) {
    now.bytes += fs::file_size(photo.mask_file, error);
    now.changed = std::max(now.changed, fs::last_write_time(photo.mask_file, error));
  }
  if (!known.name.empty() && known.bytes == now.bytes && known.changed == now.changed)
    return known.name;
  now.name =
      photo.is_frame ? key_of_frame(photo, file) : PhotoCache::key_of(photo.file, recipe_of(photo));
  known = std::move(now);
  return known.name;
}

std::string CachedPictures::key_of_frame(const Photo& photo, const Key& file) {
  const std::lock_guard lock(mutex_);
  Key& video = videos_[photo.file];
  if (video.name.empty() || video.bytes != file.bytes || video.changed != file.changed)
    video = {PhotoCache::key_of(photo.file, ""), file.bytes, file.changed};
  return PhotoCache::key_of_text(
      fmt::format("{} frame {} {}", video.name, photo.frame, recipe_of(photo)));
}

bool CachedPictures::has(std::size_t view, const Photo& photo) {
  const std::string& key = key_of(view, photo);
  return cache_.has(key) || (photo.may_be_masked && cache_.has(masked_key(key)));
}

std::optional<Picture> CachedPictures::find(std::size_t view, const Photo& photo) {
  const std::string& key = key_of(view, photo);
  const int width = photo.target.width, height = photo.target.height;
  if (photo.may_be_masked)
    if (auto both = cache_.find(masked_key(key), width, height, 4)) {
      PhotoWithAlpha apart = separated(std::move(*both));
      return Picture{std::move(apart.photo), std::move(apart.alpha)};
    }
  if (auto photo = cache_.find(key, width, height, 3)) return Picture{std::move(*photo), {}};
  return std::nullopt;
}

void CachedPictures::store(std::size_t view, const Photo& photo, const Picture& picture) {
  const std::string key = keys_.at(view).name;
  if (key_of(view, photo) != key) return;
  if (picture.mask.empty())
    cache_.store(key, picture.photo);
  else
    cache_.store(masked_key(key), joined(picture.photo, picture.mask));
}

Picture CachedPictures::picture(std::size_t view, const Photo& photo) {
  if (auto found = find(view, photo)) return std::move(*found);
  Picture picture = make_picture(photo);
  store(view, photo, picture);
  return picture;
}

std::shared_ptr<CachedPictures> cache_for(const DatasetConfig& dataset,
                                          const std::vector<Photo>& photos, bool all_fit) {
  const bool is_named = dataset.photo_cache != "auto";
  if (dataset.photo_cache == "none" || dataset.photo_cache_gib <= 0) return nullptr;
  const bool helps = std::any_of(photos.begin(), photos.end(), [&](const Photo& photo) {
    const std::int64_t pixels = std::int64_t(photo.size.width) * photo.size.height;
    return (!all_fit || photo.is_undistorted() || photo.is_resized()) &&
           (is_named || pixels >= kWorthCaching || (photo.is_frame && !all_fit));
  });
  if (!helps) return nullptr;
  if (!can_cache_photos()) {
    if (is_named) log_warning("dataset.photo_cache is not used: this build has no zstd and xxhash");
    return nullptr;
  }
  const fs::path folder = is_named ? fs::path(dataset.photo_cache) : usual_photo_cache();
  if (folder.empty()) return nullptr;
  return std::make_shared<CachedPictures>(
      folder, std::uint64_t(double(dataset.photo_cache_gib) * kBytesPerGib), photos.size());
}

}  // namespace gs
