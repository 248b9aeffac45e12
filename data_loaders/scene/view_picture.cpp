// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/view_picture.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>

#include "data_loaders/lenses/undistort.h"
#include "data_loaders/photos/photo_codec.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_core/error.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// Part of the names in the cache: raise it when read_photo(), undistorted_photo() or area_resized() give other bytes.
constexpr int kPictureVersion = 1;

/// Photo and mask as the view's camera sees them, without anything of what the mask covers.
void fit_to_camera(Picture& picture, const ViewPlan& plan) {
  constexpr int kReach = 4;  // pixels: bicubic weights of the mask reach 2 beyond its edge, those of the photo 2 more
  auto& [photo, mask] = picture;
  const bool is_masked = !mask.empty();
  const std::string& name = plan.image.name;
  if (plan.has_lens()) {
    if (is_masked) fill_masked_edge(photo, mask, kReach);
    photo = undistorted_photo(photo, plan.lens, plan.undistorted, name);
    if (is_masked) mask = undistorted_photo(mask, plan.lens, plan.undistorted, name);
  }
  if (!plan.is_resized()) return;
  const int width = plan.target.width, height = plan.target.height;
  if (is_masked) {
    multiply_by_mask(photo, mask);
    mask = area_resized(mask, width, height);
  }
  photo = area_resized(photo, width, height);
  if (is_masked) divide_by_mask(photo, mask);
}

/// All but the photo file's bytes that decides what make_picture() gives.
std::string recipe_of(const ViewPlan& plan, const MaskSource& masks) {
  std::string text = fmt::format("{} {} {}x{}", kPictureVersion, codec_name(), plan.target.width,
                                 plan.target.height);
  if (!plan.mask_file.empty())
    text += fmt::format(" mask {} {}", masks.invert, PhotoCache::key_of(plan.mask_file, ""));
  else
    text += fmt::format(" alpha {}", masks.use_alpha);
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

// The files' content decides, not their names or dates; those only tell whether they have to be read again.
std::string cache_key(ViewPlan& plan, const MaskSource& masks) {
  std::error_code error;
  CacheKey now{"", fs::file_size(plan.file, error), fs::last_write_time(plan.file, error)};
  CacheKey& known = plan.cached;
  if (!plan.mask_file.empty()) {
    now.bytes += fs::file_size(plan.mask_file, error);
    now.changed = std::max(now.changed, fs::last_write_time(plan.mask_file, error));
  }
  if (!known.key.empty() && known.bytes == now.bytes && known.changed == now.changed)
    return known.key;
  now.key = PhotoCache::key_of(plan.file, recipe_of(plan, masks));
  known = std::move(now);
  return known.key;
}

// A masked picture is an entry of its own kind, with the mask as a fourth channel.
std::string masked_key(const std::string& key) { return key + "m"; }
Image8 joined(const Picture& picture) {
  Image8 both(picture.photo.width, picture.photo.height, 4);
  for (std::size_t i = 0; i < picture.mask.pixels.size(); ++i) {
    std::copy_n(&picture.photo.pixels[3 * i], 3, &both.pixels[4 * i]);
    both.pixels[4 * i + 3] = picture.mask.pixels[i];
  }
  return both;
}

}  // namespace

bool may_be_masked(const ViewPlan& plan, const MaskSource& masks) {
  const std::string ending = lowercase_ending(plan.file);
  return !plan.mask_file.empty() || (masks.use_alpha && ending != ".jpg" && ending != ".jpeg");
}

PhotoCost cost_of(const ViewPlan& plan, const MaskSource& masks) {
  const std::size_t channels = may_be_masked(plan, masks) ? 4 : 3;
  const auto bytes = [&](const auto& size) {
    return channels * std::size_t(size.width) * size.height;
  };
  const std::size_t photo = bytes(plan.photo_size), undistorted = bytes(plan.undistorted),
                    target = bytes(plan.target);
  PhotoCost cost{target, channels == 4 ? 2 * photo : photo};  // as decoded, and then apart
  if (plan.has_lens()) cost.decoding = std::max(cost.decoding, photo + undistorted);
  if (plan.is_resized()) cost.decoding = std::max(cost.decoding, undistorted + target);
  return cost;
}

Picture make_picture(const ViewPlan& plan, const MaskSource& masks) {
  PhotoWithAlpha read = read_photo_with_alpha(plan.file);
  if (read.photo.width != plan.photo_size.width || read.photo.height != plan.photo_size.height)
    throw Error(fmt::format("photo {} has changed since the scene was loaded; start again",
                            plan.file.string()));
  Picture picture{{}, read_mask(masks, plan.mask_file, read)};
  picture.photo = std::move(read.photo);
  fit_to_camera(picture, plan);
  return picture;
}

Picture cached_picture(ViewPlan& plan, const MaskSource& masks, PhotoCache& cache) {
  const std::string key = cache_key(plan, masks);
  const int width = plan.target.width, height = plan.target.height;
  if (may_be_masked(plan, masks))
    if (auto both = cache.find(masked_key(key), width, height, 4)) {
      PhotoWithAlpha apart = separated(std::move(*both));
      return {std::move(apart.photo), std::move(apart.alpha)};
    }
  if (auto photo = cache.find(key, width, height, 3)) return {std::move(*photo), {}};
  Picture picture = make_picture(plan, masks);
  if (cache_key(plan, masks) != key) return picture;  // a file was changed meanwhile
  if (picture.mask.empty())
    cache.store(key, picture.photo);
  else
    cache.store(masked_key(key), joined(picture));
  return picture;
}

}  // namespace gs
