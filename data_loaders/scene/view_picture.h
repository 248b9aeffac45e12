// SPDX-License-Identifier: Apache-2.0
// One photo of a scene: what is known of it before it is decoded, and what it becomes, by itself or from the cache.
#pragma once

#include <filesystem>
#include <string>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/lenses/lens.h"
#include "data_loaders/photos/photo_cache.h"
#include "data_loaders/photos/photo_pool.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/scene/masks.h"

namespace gs {

/// The name of a photo in the cache, and the state of the files that it was found for.
struct CacheKey {
  std::string key;
  std::uintmax_t bytes = 0;
  std::filesystem::file_time_type changed;
};

/// All that is known of a view before its photo is decoded.
struct ViewPlan {
  ColmapImage image;
  std::filesystem::path file;
  std::filesystem::path mask_file;                 // empty: none
  PhotoSize photo_size;
  LensCamera lens;                    // at the photo's size
  PinholeCamera<double> undistorted;  // the photo without its lens, at full resolution
  PinholeCamera<double> target;       // as it is trained on
  CacheKey cached = {};               // once it was needed

  bool has_lens() const { return lens.lens != LensCamera::Lens::none; }
  bool is_resized() const {
    return target.width != undistorted.width || target.height != undistorted.height;
  }
};

/// What a photo becomes: of the camera's size, the mask empty where every pixel trains.
struct Picture {
  Image8 photo, mask;
};

/// Whether it may get a mask; only reading it tells of alpha.
bool may_be_masked(const ViewPlan& plan, const MaskSource& masks);

/// Bytes of the photo with its mask, and of what make_picture() holds at a time.
PhotoCost cost_of(const ViewPlan& plan, const MaskSource& masks);

/// Reads photo and mask, takes the lens away, makes them smaller. Throws Error that names the file.
Picture make_picture(const ViewPlan& plan, const MaskSource& masks);

/// The same from the cache, which is given what it does not have. Notes the key in the plan.
Picture cached_picture(ViewPlan& plan, const MaskSource& masks, PhotoCache& cache);

}  // namespace gs
