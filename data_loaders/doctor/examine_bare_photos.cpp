// SPDX-License-Identifier: Apache-2.0
// Photos without camera poses, before COLMAP places them: what can be said of them already.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <mutex>

#include "data_loaders/doctor/examination.h"
#include "data_loaders/photos/picture_quality.h"
#include "data_loaders/reconstruct/colmap_plan.h"
#include "data_loaders/reconstruct/foreign_cameras.h"
#include "data_loaders/reconstruct/photo_folder.h"
#include "gs_core/error.h"
#include "gs_core/system/processes/subprocess.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

using Level = Finding::Level;

constexpr float kManyStops = 2;  // between the exposures of photos

void examine_count(Examination& examination, const std::vector<PhotoFile>& photos) {
  const std::string count = counted(photos.size(), "photo");
  if (photos.size() < kFewestPhotos)
    examination.add(Level::fatal, "photos",
                    fmt::format("{}: a scene needs at least {}, and looks good with 30 or more",
                                count, kFewestPhotos));
  else if (photos.size() < kFewPhotos)
    examination.add(Level::warning, "photos",
                    fmt::format("{}: training needs every place in several photos; take more, "
                                "overlapping by two thirds",
                                count));
  else
    examination.add(Level::good, "photos", fmt::format("{} can be read", count));
}

void examine_sizes(Examination& examination, const std::vector<PhotoFile>& photos) {
  std::map<std::pair<int, int>, std::size_t> counts;
  std::vector<std::string> turned;
  for (const PhotoFile& photo : photos) {
    ++counts[{photo.size.width, photo.size.height}];
    if (photo.orientation != 1) turned.push_back(photo.name);
  }
  std::string text;
  for (const auto& [size, count] : counts)
    text += fmt::format("{}{} of {}x{}", text.empty() ? "" : ", ", count, size.first, size.second);
  examination.add(
      Level::note, "lenses",
      text + (photos[0].is_panorama ? ": panoramas of 360 degrees, placed by their views"
              : counts.size() == 1  ? ": one lens is assumed"
                                    : " pixels"));
  PhotoSize largest;
  for (const PhotoFile& photo : photos)
    if (std::int64_t(photo.size.width) * photo.size.height >
        std::int64_t(largest.width) * largest.height)
      largest = photo.size;
  report_reduced_photos(examination, largest);
  if (!turned.empty())
    examination.add(Level::note, "orientation",
                    fmt::format("{} turned upright for the scene, as EXIF says",
                                counted(turned.size(), "photo", "is", "are")),
                    turned);
}

void examine_exposures(Examination& examination, const std::vector<PhotoFile>& photos) {
  std::vector<float> stops;
  for (const PhotoFile& photo : photos)
    if (const auto known = read_exposure_stops(photo.path)) stops.push_back(*known);
  if (stops.empty()) return;
  const auto [least, most] = std::minmax_element(stops.begin(), stops.end());
  const bool differ = *most - *least > kManyStops;
  examination.add(differ ? Level::warning : Level::good, "light",
                  fmt::format("EXIF says of {} of {} how they were exposed: they differ by {:.1f} "
                              "stops{}",
                              stops.size(), counted(photos.size(), "photo"), *most - *least,
                              differ ? "; hold the exposure, or train with --exposure" : ""));
}

void examine_pixels(Examination& examination, const std::vector<PhotoFile>& photos) {
  std::vector<PictureQuality> qualities(photos.size());
  std::vector<char> is_damaged(photos.size(), false);
  std::mutex mutex;
  std::size_t done = 0;
  parallel_for(photos.size(), 1, [&](std::size_t i) {
    try {
      qualities[i] = quality_of(read_photo(photos[i].path));
    } catch (const Error&) {
      is_damaged[i] = true;
    }
    const std::lock_guard lock(mutex);
    if (examination.progress) examination.progress(++done, photos.size());
  });
  std::vector<std::string> damaged, names;
  std::vector<PictureQuality> readable;
  for (std::size_t i = 0; i < photos.size(); ++i) {
    (is_damaged[i] ? damaged : names).push_back(photos[i].name);
    if (!is_damaged[i]) readable.push_back(qualities[i]);
  }
  if (!damaged.empty())
    examination.add(Level::warning, "photos",
                    fmt::format("{} damaged and will not be placed; copy the files again",
                                counted(damaged.size(), "photo", "is", "are")),
                    damaged);
  report_quality(examination, names, readable);
}

}  // namespace

bool examine_bare_photos(Examination& examination, bool look_at_pictures) {
  const DatasetConfig& dataset = examination.config.dataset;
  const bool places_are_named = !dataset.model.empty() || dataset.images != DatasetConfig{}.images;
  try {
    if (dataset.source.empty() || places_are_named || !holds_only_photos(dataset.source))
      return false;
    if (const auto foreign = find_foreign_cameras(dataset.source))
      throw Error(text_of(*foreign, dataset.source));
    if (const auto videos = find_videos(dataset.source); !videos.empty()) {
      examination.add(Level::good, "scene",
                      fmt::format("{} without camera poses: `train` takes the sharpest frames, and "
                                  "COLMAP places them; so does `gemsplat reconstruct`",
                                  counted(videos.size(), "video")));
    } else {
      const std::vector<PhotoFile> photos = find_photos(dataset.source, {});
      examination.add(Level::good, "scene",
                      "photos without camera poses: `train` lets COLMAP place them, and so does "
                      "`gemsplat reconstruct`; ask `doctor` again about the scene that it makes");
      examine_count(examination, photos);
      examine_sizes(examination, photos);
      examine_exposures(examination, photos);
      if (look_at_pictures) examine_pixels(examination, photos);
    }
  } catch (const Error& error) {
    examination.add(Level::fatal, "scene", error.what());
    return true;
  }
  if (!find_program(examination.config.reconstruct.colmap))
    examination.add(Level::fatal, "scene",
                    fmt::format("the program {} is not there, which places the cameras; install it "
                                "(Debian, Ubuntu: apt install colmap) or name it with --set "
                                "reconstruct.colmap=PATH",
                                examination.config.reconstruct.colmap));
  return true;
}

}  // namespace gs
