// SPDX-License-Identifier: Apache-2.0
// The parts of an examination that look at files: photos and masks, headers, pictures.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <tuple>

#include "data_loaders/doctor/examination.h"
#include "data_loaders/photos/photo_fit.h"
#include "data_loaders/scene/place_scene.h"
#include "data_loaders/scene/view_picture.h"
#include "data_loaders/video/film_frames.h"
#include "gs_core/camera.h"
#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Level = Finding::Level;

constexpr double kHardlyTrained = 0.05;  // of a photo's pixels: the mask may be inverted

/// Pictures in the photos' folder that the model does not name. COLMAP may have failed to place
/// them. Other programs write depth and normal maps, or validation photos, into the same folder.
void report_unused(Examination& examination) {
  const std::vector<std::string> unused = pictures_besides(examination.scene);
  if (unused.empty()) return;
  if (examination.scene.folders.kind != SceneKind::colmap) {
    const SceneKind kind = examination.scene.folders.kind;
    examination.add(
        Level::note, "photos",
        fmt::format("{} not used: {}",
                    counted(unused.size(), "picture", "in the folder is", "in the folder are"),
                    kind == SceneKind::blender
                        ? "neither transforms_train.json nor the file of the test photos names them"
                    : kind == SceneKind::foreign
                        ? "the file with the cameras has no poses of them"
                        : "transforms.json does not name them, or its lists leave them out"),
        unused);
    return;
  }
  examination.add(unused.size() > examination.model().images.size() ? Level::warning : Level::note,
                  "photos",
                  fmt::format("{} not in the model: COLMAP could not place them, or never saw them",
                              counted(unused.size(), "photo", "there is", "there are")),
                  unused);
}

/// `shares`: of the pixels that train, for each of the photos `readable`; 1 without a mask.
void report_masks(Examination& examination, const std::vector<std::size_t>& readable,
                  const std::vector<double>& shares) {
  std::vector<std::size_t> masked, hardly;
  double sum = 0;
  for (std::size_t k = 0; k < readable.size(); ++k) {
    if (shares[k] >= 1) continue;
    masked.push_back(readable[k]);
    sum += shares[k];
    if (shares[k] < kHardlyTrained) hardly.push_back(readable[k]);
  }
  if (masked.empty()) return;
  examination.masked_share = double(masked.size()) / double(readable.size());
  const bool is_background = examination.scene.photos[0].masks.over_background;
  examination.add(
      Level::good, "masks",
      fmt::format("{} of {} are masked; {:.1f} % of their pixels {}", masked.size(),
                  counted(readable.size(), "photo"), 100 * sum / double(masked.size()),
                  is_background ? "show the scene, the others its background" : "train"));
  if (!hardly.empty())
    examination.add(
        Level::warning, "masks",
        fmt::format("{} less than {:.0f} % of the photo to train on; if black pixels shall be "
                    "trained, invert the masks with --invert-masks",
                    counted(hardly.size(), "mask", "leaves", "leave"), 100 * kHardlyTrained),
        examination.names_of(hardly));
  if (!is_background && sum == 0 && masked.size() == examination.scene.photos.size())
    examination.add(Level::fatal, "masks",
                    "no photo has a pixel to train on; invert the masks with --invert-masks");
}

/// The contents of one photo's header.
struct Header {
  std::string error;  // empty if it could be read
  int orientation = 1;
};

std::pair<PhotoSize, Header> read_video_header(const fs::path& video) {
  try {
    const Image8 first = read_frame(video, 0);
    return {{first.width, first.height}, {}};
  } catch (const Error& error) {
    return {{}, {error.what(), 1}};
  }
}

std::vector<Header> read_headers(std::vector<Photo>& photos) {
  std::vector<Header> headers(photos.size());
  std::map<fs::path, std::pair<PhotoSize, Header>> of_videos;
  for (std::size_t i = 0; i < photos.size(); ++i) {
    if (!photos[i].is_frame) continue;
    const auto [known, is_new] = of_videos.try_emplace(photos[i].file);
    if (is_new) known->second = read_video_header(photos[i].file);
    std::tie(photos[i].size, headers[i]) = known->second;
  }
  parallel_for(photos.size(), 8, [&](std::size_t i) {
    if (photos[i].file.empty() || photos[i].is_frame) return;
    try {
      photos[i].size = read_photo_size(photos[i].file);
      headers[i].orientation = read_photo_orientation(photos[i].file);
    } catch (const Error& error) {
      headers[i].error = error.what();
    }
  });
  return headers;
}

}  // namespace

void report_quality(Examination& examination, const std::vector<std::string>& names,
                    const std::vector<PictureQuality>& qualities) {
  const QualityOutliers outliers = outliers_of(qualities);
  const auto named = [&](const std::vector<std::size_t>& which) {
    std::vector<std::string> some;
    for (const std::size_t k : which) some.push_back(names[k]);
    return some;
  };
  if (outliers.blurred.empty() && outliers.odd_exposure.empty())
    examination.add(Level::good, "pictures",
                    "none is much less sharp or much darker or brighter than the others");
  if (!outliers.blurred.empty())
    examination.add(Level::warning, "pictures",
                    fmt::format("{} far less sharp than the others; leaving them out may give a "
                                "sharper scene",
                                counted(outliers.blurred.size(), "photo", "is", "are")),
                    named(outliers.blurred));
  if (!outliers.odd_exposure.empty())
    examination.add(Level::warning, "pictures",
                    fmt::format("{} far darker or brighter than the others; colors there will be "
                                "a compromise (--exposure may help)",
                                counted(outliers.odd_exposure.size(), "photo", "is", "are")),
                    named(outliers.odd_exposure));
}

void report_reduced_photos(Examination& examination, const PhotoSize& largest) {
  if (examination.config.dataset.resolution != 0 ||
      std::max(largest.width, largest.height) <= kUsualSide)
    return;
  const Camera reduced = at_resolution(Camera{largest.width, largest.height}, 0);
  examination.add(Level::note, "pictures",
                  note_on_reduced_photos(largest, {reduced.width, reduced.height}));
}

void match_photo_files(Examination& examination) {
  SceneModel& scene = examination.scene;
  const std::string count = counted(scene.photos.size(), "photo");
  match_photos(scene);
  const LostPhotos lost = lost_photos(scene);
  const Level level = lost.are_few ? Level::warning : Level::fatal;
  const char* const rest = lost.are_few ? "; training goes on without them, or " : "; ";
  if (lost.missing.empty())
    examination.add(Level::good, "photos", fmt::format("all {} of the model are there", count));
  else
    examination.add(
        level, "photos",
        fmt::format("{} of the model's {} are not in {}{}{}", lost.missing.size(), count,
                    scene.folders.images.string(), rest,
                    remedy_of_missing(scene.photos[lost.missing[0]].name, scene.folders.images)),
        examination.names_of(lost.missing));
  if (!lost.cut_short.empty())
    examination.add(level, "photos",
                    fmt::format("{} cut short{}copy the files again",
                                counted(lost.cut_short.size(), "photo", "is", "are"), rest),
                    examination.names_of(lost.cut_short));
  report_unused(examination);
  for (const std::size_t i : lost.cut_short) scene.photos[i].file.clear();
}

bool match_files_of(const CompanionKind& kind, Level of_missing, const char* without,
                    Examination& examination) {
  SceneModel& scene = examination.scene;
  const char* const topic = kind.folder;
  try {
    match_companions(kind, examination.config.dataset, scene);
  } catch (const Error& error) {
    examination.add(Level::fatal, topic, error.what());
    return false;
  }
  std::vector<std::size_t> missing;
  for (std::size_t i = 0; i < scene.photos.size(); ++i)
    if ((scene.photos[i].*kind.file).empty()) missing.push_back(i);
  const std::size_t count = scene.photos.size();
  if (missing.size() == count) return false;
  examination.add(Level::good, topic,
                  fmt::format("{} of {} have a {} in {}", count - missing.size(),
                              counted(count, "photo"), kind.noun, (scene.*kind.source).place()));
  if (!missing.empty())
    examination.add(masks_may_be_lost(missing.size(), count) ? of_missing : Level::note, topic,
                    fmt::format("{} no {} there{}", counted(missing.size(), "photo", "has", "have"),
                                kind.noun, without),
                    examination.names_of(missing));
  return true;
}

void match_mask_files(Examination& examination) {
  match_files_of(kMasks, Level::warning,
                 ": all their pixels are trained, except where alpha masks them", examination);
}

void examine_headers(Examination& examination) {
  std::vector<Photo>& photos = examination.scene.photos;
  const std::vector<Header> headers = read_headers(photos);
  std::vector<std::size_t> unreadable, turned, other, scaled, with_orientation;
  for (std::size_t i = 0; i < headers.size(); ++i) {
    if (photos[i].file.empty()) continue;
    if (!headers[i].error.empty()) {
      unreadable.push_back(i);
      continue;
    }
    const ColmapModel& model = examination.model();
    const ColmapCamera& camera = model.cameras.at(model.images[i].camera_id);
    const PhotoFit fit = fit_of(photos[i].size, {camera.width, camera.height});
    if (fit == PhotoFit::turned) turned.push_back(i);
    if (fit == PhotoFit::other) other.push_back(i);
    if (fit == PhotoFit::fits && photos[i].size.width != camera.width) scaled.push_back(i);
    if (headers[i].orientation != 1) with_orientation.push_back(i);
    if (fit == PhotoFit::fits) examination.usable.push_back(i);
  }
  const auto add = [&](Level level, const char* topic, const std::vector<std::size_t>& some,
                       const char* one, const char* more, const char* text) {
    if (!some.empty())
      examination.add(level, topic, counted(some.size(), "photo", one, more) + text,
                      examination.names_of(some));
  };
  if (!unreadable.empty())
    examination.add(
        Level::fatal, "photos",
        fmt::format("{} cannot be read ({}); fetch them again, or leave them out of "
                    "the model",
                    counted(unreadable.size(), "photo"), headers[unreadable.front()].error),
        examination.names_of(unreadable));
  add(Level::fatal, "orientation", turned, "lies", "lie",
      " on the side compared with the model: the EXIF orientation was followed once and ignored "
      "once; turn the pixels themselves (`mogrify -auto-orient` on copies) and give COLMAP and "
      "gemsplat these same files");
  if (turned.empty())
    add(Level::note, "orientation", with_orientation, "asks", "ask",
        " viewers to turn the picture (EXIF); COLMAP and gemsplat take the pixels as they are "
        "stored, so the trained scene fits, but other programs may turn them");
  add(Level::fatal, "photos", other, "has", "have",
      " another shape than the camera in the model: these are not the photos that COLMAP saw; use "
      "the same photos, or run COLMAP again");
  PhotoSize largest;
  for (const std::size_t i : examination.usable) {
    const PhotoSize size = examination.picture_size_of(i);
    if (double(size.width) * size.height > double(largest.width) * largest.height) largest = size;
  }
  if (largest.width > 0) report_reduced_photos(examination, largest);
  if (!scaled.empty())
    examination.add(
        Level::note, "photos",
        fmt::format("{} another size than the camera in the model; the intrinsics are scaled",
                    counted(scaled.size(), "photo", "has", "have")));
}

void examine_pictures(Examination& examination) {
  const std::vector<std::size_t>& usable = examination.usable;
  const auto photo = [&](std::size_t k) -> const Photo& {
    return examination.scene.photos[usable[k]];
  };
  std::vector<PictureQuality> qualities(usable.size());
  std::vector<double> shares(usable.size(), 1);
  std::vector<char> is_damaged(usable.size(), true);
  std::mutex mutex;
  std::size_t done = 0;
  const auto rate = [&](std::size_t k, const PhotoWithAlpha& read) {
    qualities[k] = quality_of(read.photo);
    shares[k] = trained_share(read_mask(photo(k).masks, photo(k).mask_file, read));
    is_damaged[k] = false;
  };
  const auto count = [&] {
    const std::lock_guard lock(mutex);
    if (examination.progress) examination.progress(++done, usable.size());
  };
  std::map<fs::path, std::vector<std::size_t>> of_videos;
  for (std::size_t k = 0; k < usable.size(); ++k)
    if (photo(k).is_frame) of_videos[photo(k).file].push_back(k);
  parallel_for(usable.size(), 1, [&](std::size_t k) {
    if (photo(k).is_frame) return;
    try {
      rate(k, read_photo_with_alpha(photo(k).file));
    } catch (const Error&) {  // it stays damaged
    }
    count();
  });
  for (const auto& [video, own] : of_videos) {
    std::vector<VideoFrame> frames;
    for (const std::size_t k : own) frames.push_back({video, photo(k).frame});
    const auto is_wanted = [](std::size_t) { return true; };
    try {
      for_each_frame(frames, 1, is_wanted, [&, &own = own](std::size_t i, Image8 frame) {
        rate(own[i], {std::move(frame), {}});
        count();
      });
    } catch (const Error&) {  // the frames that remain are damaged
    }
  }
  std::vector<std::size_t> damaged, readable;
  std::vector<PictureQuality> readable_qualities;
  std::vector<double> readable_shares;
  for (std::size_t k = 0; k < usable.size(); ++k) {
    if (is_damaged[k]) {
      damaged.push_back(usable[k]);
      continue;
    }
    readable.push_back(usable[k]);
    readable_qualities.push_back(qualities[k]);
    readable_shares.push_back(shares[k]);
  }
  if (!damaged.empty())
    examination.add(Level::fatal, "photos",
                    fmt::format("{} damaged, or the mask is; fetch the files again, or leave the "
                                "photos out of the model",
                                counted(damaged.size(), "photo", "is", "are")),
                    examination.names_of(damaged));
  report_masks(examination, readable, readable_shares);
  report_quality(examination, examination.names_of(readable), readable_qualities);
}

}  // namespace gs
