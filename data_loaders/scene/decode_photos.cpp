// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/decode_photos.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>

#include <spdlog/fmt/fmt.h>

#include "data_loaders/photos/photo_pool.h"
#include "data_loaders/scene/cached_picture.h"
#include "data_loaders/scene/depth/depth_map.h"
#include "data_loaders/scene/normal_map.h"
#include "data_loaders/scene/view_picture.h"
#include "data_loaders/video/film_frames.h"
#include "gs_core/error.h"
#include "gs_core/system/bytes.h"
#include "gs_core/system/host_ram.h"
#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr double kCachedShare = 0.5;  // of decoded bytes that are kept, in most photos
constexpr int kMostDecoders = 16;     // threads of a PhotoPool
constexpr std::size_t kBytesForLooking = std::size_t(1) << 30;  // of photos, with when_asked

std::size_t pixel_count(const PhotoSize& size) {
  return std::size_t(size.width) * std::size_t(size.height);
}

View whole_panorama(Photo half);

/// A view without its picture.
View empty_view(const Photo& photo) {
  View view;
  view.name = photo.name;
  view.camera = photo.camera;
  view.camera_id = photo.camera_id;
  view.rig_frame = photo.rig_frame;
  view.exposure_stops = photo.exposure_stops;
  view.may_be_masked = photo.may_be_masked;
  view.over_background = photo.masks.over_background && view.may_be_masked;
  view.has_depth_map = !photo.depth_file.empty();
  view.has_normal_map = !photo.normal_file.empty();
  view.depth_kind = photo.depth_kind;
  if (photo.lens.is_hemisphere() && !photo.is_back)
    view.panorama = [photo] { return whole_panorama(photo); };
  return view;
}

View view_with(Picture picture, const Photo& photo) {
  View view = empty_view(photo);
  view.photo = std::move(picture.photo);
  view.mask = std::move(picture.mask);
  view.over_background = photo.masks.over_background && !view.mask.empty();
  if (view.has_depth_map) {
    DepthMap map = make_depth_map(photo);
    view.depth = std::move(map.values);
    view.depth_kind = map.kind;
  }
  if (view.has_normal_map) view.normals = make_normals(photo);
  return view;
}

/// View::panorama.
View whole_panorama(Photo half) {
  const double scale = double(half.target.width) / half.undistorted.width;
  const auto side = [&](int pixels) { return int(std::lround(scale * pixels)); };
  half.lens = {};
  half.is_explained = true;
  half.undistorted = {half.size.width, half.size.height};
  half.target = {side(half.size.width), side(half.size.height)};
  return view_with(make_picture(half), half);
}

/// `cache` may be null.
View load_view(std::size_t index, const Photo& photo, CachedPictures* cache) {
  return view_with(cache ? cache->picture(index, photo) : make_picture(photo), photo);
}

bool has_frames(const std::vector<Photo>& photos) {
  return std::ranges::any_of(photos, [](const Photo& photo) { return photo.is_frame; });
}

/// Makes the pictures of frames of videos within `budget` bytes, each video decoded once
/// (for_each_frame()).
void for_each_film_picture(const std::vector<Photo>& photos, std::size_t budget,
                           const std::function<bool(std::size_t view)>& wants,
                           const std::function<void(std::size_t view, Picture picture)>& take) {
  std::vector<std::size_t> views;
  std::vector<VideoFrame> frames;
  std::size_t cost = 1;  // bytes of one frame in the making
  for (std::size_t i = 0; i < photos.size(); ++i) {
    if (!photos[i].is_frame) continue;
    views.push_back(i);
    frames.push_back({photos[i].file, photos[i].frame});
    cost = std::max(cost, photos[i].cost.decoding);
  }
  const std::size_t most_at_once = std::clamp<std::size_t>(budget / cost, 1, thread_count());
  for_each_frame(
      frames, most_at_once, [&](std::size_t k) { return wants(views[k]); },
      [&](std::size_t k, Image8 frame) {
        take(views[k], make_picture(photos[views[k]], {std::move(frame), {}}));
      });
}

/// All photos decoded.
std::vector<View> load_views(const std::vector<Photo>& photos, CachedPictures* cache,
                             const LoadProgress& progress) {
  std::vector<View> views(photos.size());
  std::atomic<bool> has_failed = false;  // then the others need not be decoded
  std::mutex mutex;
  std::size_t done = 0;
  const auto count = [&] {
    const std::lock_guard lock(mutex);
    if (progress) progress(LoadStage::photos, ++done, photos.size());
  };
  parallel_for(photos.size(), 1, [&](std::size_t i) {
    if (has_failed) return;
    try {
      if (!photos[i].is_frame)
        views[i] = load_view(i, photos[i], cache);
      else if (auto kept = cache ? cache->find(i, photos[i]) : std::nullopt)
        views[i] = view_with(std::move(*kept), photos[i]);
      else
        return;  // decoded below, in the order of its video
    } catch (...) {
      has_failed = true;
      throw;
    }
    count();
  });
  for_each_film_picture(
      photos, std::numeric_limits<std::size_t>::max(),  // fit_into_ram() has counted all threads
      [&](std::size_t i) { return views[i].photo.empty(); },
      [&](std::size_t i, Picture picture) {
        if (cache) cache->store(i, photos[i], picture);
        views[i] = view_with(std::move(picture), photos[i]);
        count();
      });
  return views;
}

/// Puts the frames of videos into the cache, because a PhotoPool asks for them in any order. Warns
/// of those that it does not take. `cache` may be null.
void keep_frames(const std::vector<Photo>& photos, CachedPictures* cache, std::size_t budget,
                 const LoadProgress& progress) {
  const auto frames =
      std::size_t(std::ranges::count_if(photos, [](const Photo& photo) { return photo.is_frame; }));
  if (frames == 0) return;
  std::size_t kept = 0;
  if (cache) {
    std::mutex mutex;
    const auto count = [&] {
      const std::lock_guard lock(mutex);
      if (progress) progress(LoadStage::photos, ++kept, frames);
    };
    for_each_film_picture(
        photos, budget,
        [&](std::size_t i) {
          const bool is_kept = cache->has(i, photos[i]);
          if (is_kept) count();
          return !is_kept;
        },
        [&](std::size_t i, Picture picture) {
          cache->store(i, photos[i], picture);
          if (cache->has(i, photos[i])) count();
        });
  }
  if (kept < frames)
    log_warning(
        "{} of {} frames of videos fit neither into memory (--photo-ram) nor into the photo cache "
        "(dataset.photo_cache, dataset.photo_cache_gib): whenever one of them is needed, its video "
        "is decoded from the beginning, which is slow; give one of the two more, or train at a "
        "lower resolution (-r)",
        frames - kept, frames);
}

/// Whether all photos fit into memory at once while the last ones are still being decoded.
bool fit_into_ram(const std::vector<PhotoCost>& costs, std::size_t budget) {
  std::size_t held = 0, decoding = 0;
  for (const PhotoCost& cost : costs) {
    held += cost.held;
    decoding = std::max(decoding, cost.decoding);
  }
  return held + std::min<std::size_t>(std::size_t(thread_count()), costs.size()) * decoding <=
         budget;
}

/// Says that large photos are reduced, where no setting asked for it.
void report_reduced_photos(const std::vector<Photo>& photos, int resolution) {
  if (resolution != 0) return;
  PhotoSize largest, reduced;
  for (const Photo& photo : photos) {
    const PhotoSize whole{photo.lens.pinhole.width, photo.lens.pinhole.height};
    if (!photo.is_resized() || pixel_count(whole) <= pixel_count(largest)) continue;
    largest = whole;
    reduced = {photo.target.width, photo.target.height};
  }
  if (largest.width > 0) log_info("{}", note_on_reduced_photos(largest, reduced));
}

/// Views without photos, and a pool that decodes them on demand.
std::vector<View> lazy_views(std::vector<Photo> photos, std::vector<PhotoCost> costs,
                             std::size_t budget, std::shared_ptr<CachedPictures> cache) {
  std::vector<View> views;
  for (const Photo& photo : photos) {
    views.push_back(empty_view(photo));
    views.back().index = views.size() - 1;
  }
  const auto shared = std::make_shared<const std::vector<Photo>>(std::move(photos));
  const auto pool = std::make_shared<PhotoPool>(
      std::move(costs),
      [shared, cache](std::size_t i) { return load_view(i, (*shared)[i], cache.get()); }, budget,
      std::clamp(thread_count() - 1, 1, kMostDecoders));
  for (View& view : views) view.source = pool;
  return views;
}

}  // namespace

std::vector<View> decode_photos(const DatasetConfig& dataset, std::vector<Photo> photos,
                                const LoadProgress& progress, PhotoLoading loading) {
  std::vector<PhotoCost> costs;
  double held = 0;
  for (const Photo& photo : photos) {
    costs.push_back(photo.cost);
    held += double(costs.back().held);
  }
  if (loading == PhotoLoading::when_asked) {
    const std::size_t budget = std::max(kBytesForLooking, PhotoPool::least_budget(costs));
    const std::shared_ptr<CachedPictures> kept =  // by training, perhaps
        has_frames(photos) ? cache_for(dataset, photos, false) : nullptr;
    return lazy_views(std::move(photos), std::move(costs), budget, kept);
  }
  report_reduced_photos(photos, dataset.resolution);
  std::size_t budget = photo_ram_bytes(double(dataset.photo_ram_gib));
  const bool all_fit = fit_into_ram(costs, budget);
  const std::shared_ptr<CachedPictures> cache = cache_for(dataset, photos, all_fit);
  if (cache)
    log_info("photos that are ready for training are kept in {}, and take up to {:.2g} GiB there",
             cache->folder().string(), kCachedShare * held / kBytesPerGib);
  if (all_fit) return load_views(photos, cache.get(), progress);
  const std::size_t least = PhotoPool::least_budget(costs);
  if (dataset.photo_ram_gib > 0 && budget < least)
    throw UsageError(fmt::format(
        "dataset.photo_ram_gib is {}, but one of these photos in use while another one is decoded "
        "takes {:.3g}; give at least that (--photo-ram), or 0 for half of the machine's memory",
        dataset.photo_ram_gib, 1.01 * double(least) / kBytesPerGib));
  budget = std::max(budget, least);
  log_info(
      "the photos take {:.3g} GiB when decoded, but may take {:.3g} GiB of memory (--photo-ram): "
      "they are decoded just before their turn",
      held / kBytesPerGib, double(budget) / kBytesPerGib);
  keep_frames(photos, cache.get(), budget, progress);
  return lazy_views(std::move(photos), std::move(costs), budget, cache);
}

}  // namespace gs
