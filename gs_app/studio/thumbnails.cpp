// SPDX-License-Identifier: Apache-2.0
#include "gs_app/studio/thumbnails.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <mutex>

#include "data_loaders/photos/encode/encode_jpeg.h"
#include "data_loaders/photos/orientation.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_app/studio/chosen_photos.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/atomic_file.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr int kQuality = 80;

Image8 reduced(const fs::path& photo, int longer_side) {
  const Image8 whole = upright(read_photo(photo), read_photo_orientation(photo));
  const double scale = std::min(1.0, double(longer_side) / std::max(whole.width, whole.height));
  const auto side = [&](int pixels) { return std::max(1, int(pixels * scale + 0.5)); };
  return area_resized(whole, side(whole.width), side(whole.height));
}

}  // namespace

fs::path thumbnail_of(const Project& project, const std::string& name,
                      const ThumbnailShape& shape) {
  static std::mutex one_at_a_time;
  const auto& [degrees, side] = shape;
  const std::string kind = (degrees ? fmt::format(".{}", degrees) : "") +
                           (side != kThumbnailSide ? fmt::format(".{}px", side) : "");
  const fs::path photo = photo_folder_of(project) / safe_path(name),
                 kept = project.folder / ".thumbs" / (name + kind + ".jpg");
  if (!is_picture(photo) || !is_file(photo)) throw UsageError("there is no such photo");
  const std::lock_guard lock(one_at_a_time);
  if (is_file(kept) && fs::last_write_time(kept) >= fs::last_write_time(photo)) return kept;
  const auto jpeg = encode_jpeg(turned(reduced(photo, side), degrees), kQuality);
  AtomicFile file(kept);
  file.write(jpeg.data(), jpeg.size());
  file.commit(AtomicFile::Durability::unsynced);
  return kept;
}

}  // namespace gs
