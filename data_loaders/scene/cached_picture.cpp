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
std::string recipe_of(const ViewPlan& plan) {
  std::string text =
      fmt::format("{} {} {}x{}", kPictureVersion, plan.is_frame ? video_codec_name() : codec_name(),
                  plan.target.width, plan.target.height);
  if (!plan.mask_file.empty())
    text += fmt::format(" mask {} {}", plan.masks.invert, PhotoCache::key_of(plan.mask_file, ""));
  else
    text += fmt::format(" alpha {}", plan.masks.use_alpha);
  if (!plan.has_lens()) return text;
  text += fmt::format(" {} {}", resampler_name(), int(plan.lens.lens));
  const auto add = [&](const auto& numbers) {
    for (const double number : numbers) text += fmt::format(" {:a}", number);
  };
  add(plan.lens.k), add(plan.lens.d), add(plan.lens.p), add(plan.lens.s);
  for (const PinholeCamera<double>* camera : {&plan.lens.pinhole, &plan.undistorted})
    add(std::array<double, 6>{double(camera->width), double(camera->height), camera->fx, camera->fy,
                              camera->cx, camera->cy});
  return text;
}

// A masked picture is an entry of its own kind, with the mask as a fourth channel.
std::string masked_key(const std::string& key) { return key + "m"; }

}  // namespace

// The content of the files decides. Their sizes and dates only tell whether to read them again.
const std::string& CachedPictures::key_of(std::size_t view, const ViewPlan& plan) {
  std::error_code error;
  const Key file{"", fs::file_size(plan.file, error), fs::last_write_time(plan.file, error)};
  Key now = file;
  Key& known = keys_.at(view);
  if (!plan.mask_file.empty()) {
    now.bytes += fs::file_size(plan.mask_file, error);
    now.changed = std::max(now.changed, fs::last_write_time(plan.mask_file, error));
  }
  if (!known.name.empty() && known.bytes == now.bytes && known.changed == now.changed)
    return known.name;
  now.name =
      plan.is_frame ? key_of_frame(plan, file) : PhotoCache::key_of(plan.file, recipe_of(plan));
  known = std::move(now);
  return known.name;
}

std::string CachedPictures::key_of_frame(const ViewPlan& plan, const Key& file) {
  const std::lock_guard lock(mutex_);
  Key& video = videos_[plan.file];
  if (video.name.empty() || video.bytes != file.bytes || video.changed != file.changed)
    video = {PhotoCache::key_of(plan.file, ""), file.bytes, file.changed};
  return PhotoCache::key_of_text(
      fmt::format("{} frame {} {}", video.name, plan.frame, recipe_of(plan)));
}

bool CachedPictures::has(std::size_t view, const ViewPlan& plan) {
  const std::string& key = key_of(view, plan);
  return cache_.has(key) || (plan.may_be_masked && cache_.has(masked_key(key)));
}

std::optional<Picture> CachedPictures::find(std::size_t view, const ViewPlan& plan) {
  const std::string& key = key_of(view, plan);
  const int width = plan.target.width, height = plan.target.height;
  if (plan.may_be_masked)
    if (auto both = cache_.find(masked_key(key), width, height, 4)) {
      PhotoWithAlpha apart = separated(std::move(*both));
      return Picture{std::move(apart.photo), std::move(apart.alpha)};
    }
  if (auto photo = cache_.find(key, width, height, 3)) return Picture{std::move(*photo), {}};
  return std::nullopt;
}

void CachedPictures::store(std::size_t view, const ViewPlan& plan, const Picture& picture) {
  const std::string key = keys_.at(view).name;
  if (key_of(view, plan) != key) return;
  if (picture.mask.empty())
    cache_.store(key, picture.photo);
  else
    cache_.store(masked_key(key), joined(picture.photo, picture.mask));
}

Picture CachedPictures::picture(std::size_t view, const ViewPlan& plan) {
  if (auto found = find(view, plan)) return std::move(*found);
  Picture picture = make_picture(plan);
  store(view, plan, picture);
  return picture;
}

std::shared_ptr<CachedPictures> cache_for(const DatasetConfig& dataset,
                                          const std::vector<ViewPlan>& plans, bool all_fit) {
  const bool is_named = dataset.photo_cache != "auto";
  if (dataset.photo_cache == "none" || dataset.photo_cache_gib <= 0) return nullptr;
  const bool helps = std::any_of(plans.begin(), plans.end(), [&](const ViewPlan& plan) {
    const std::int64_t pixels = std::int64_t(plan.photo_size.width) * plan.photo_size.height;
    return (!all_fit || plan.has_lens() || plan.is_resized()) &&
           (is_named || pixels >= kWorthCaching || (plan.is_frame && !all_fit));
  });
  if (!helps) return nullptr;
  if (!can_cache_photos()) {
    if (is_named) log_warning("dataset.photo_cache is not used: this build has no zstd and xxhash");
    return nullptr;
  }
  const fs::path folder = is_named ? fs::path(dataset.photo_cache) : usual_photo_cache();
  if (folder.empty()) return nullptr;
  return std::make_shared<CachedPictures>(
      folder, std::uint64_t(double(dataset.photo_cache_gib) * kBytesPerGib), plans.size());
}

}  // namespace gs
