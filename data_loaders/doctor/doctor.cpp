// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/doctor/doctor.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/doctor/forecast.h"
#include "data_loaders/lenses/lens.h"
#include "data_loaders/lenses/undistort.h"
#include "data_loaders/photos/photo_fit.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/photos/picture_quality.h"
#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/masks.h"
#include "data_loaders/scene/scene_model.h"
#include "gs_core/error.h"
#include "gs_core/io/host_ram.h"
#include "gs_core/math/rotation.h"
#include "gs_core/parallel.h"
#include "gs_core/scene_frame.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Level = Finding::Level;

constexpr std::size_t kFewPhotos = 20;          // fewer seldom show a scene from all sides
constexpr std::size_t kFewObservations = 3;     // points seen in fewer photos are not to be relied on
constexpr double kLargeError = 2;               // pixels, mean reprojection error
constexpr double kHardlyTrained = 0.05;         // of a photo's pixels: less looks like a mask turned round
constexpr double kUpSpread = 30;                // degrees (SceneFrame); more: nothing says which way is up

// The scene as far as it could be read.
struct FoundScene {
  SceneFolders folders;
  ColmapModel model;
  Vec3d world_offset{0.0, 0.0, 0.0};    // taken off its coordinates
  std::vector<fs::path> files;          // of each image; empty: missing
  std::vector<PhotoSize> photo_sizes;   // 0 x 0 where unknown
  std::vector<std::size_t> usable;      // images whose photo can be trained on
  MaskSource masks;
  std::vector<fs::path> mask_files;     // of each image; empty: none
};

class Examination {
 public:
  Examination(const Config& config, const ProgressFn& progress)
      : config_(config), progress_(progress) {}

  Diagnosis run(bool look_at_pictures) {
    if (!find() || !read_model()) return std::move(diagnosis_);
    match_photos_to_names();
    match_masks_to_photos();
    read_headers();
    if (look_at_pictures) look_at_all_pictures();
    examine_cameras();
    examine_points();
    forecast();
    check_the_rest();
    return std::move(diagnosis_);
  }

 private:
  void add(Level level, std::string topic, std::string text, std::vector<std::string> names = {}) {
    diagnosis_.findings.push_back({level, std::move(topic), std::move(text), std::move(names)});
  }
  std::vector<std::string> names_of(const std::vector<std::size_t>& images) const {
    std::vector<std::string> names;
    for (const std::size_t i : images) names.push_back(scene_.model.images[i].name);
    return names;
  }

  bool find() {
    try {
      scene_.folders = find_scene(config_.dataset);
    } catch (const Error& error) {
      const std::size_t photos = picture_names_in(config_.dataset.source).size();
      add(Level::fatal, "scene", error.what());
      if (photos > 0)
        add(Level::note, "scene",
            fmt::format("the folder holds {} photos and no model: `gemsplat reconstruct` makes one",
                        photos));
      return false;
    }
    add(Level::good, "scene",
        fmt::format("model in {}, photos in {}", scene_.folders.model.string(),
                    scene_.folders.images.string()));
    return true;
  }

  bool read_model() {
    SceneModel read;
    try {
      read = read_scene_model(config_.dataset, scene_.folders);
    } catch (const Error& error) {
      add(Level::fatal, "model", error.what());
      return false;
    }
    scene_.model = std::move(read.model);
    scene_.world_offset = read.world_offset;
    const ColmapModel& model = scene_.model;
    std::string text = fmt::format("{} photos placed, {} lenses, {} points", model.images.size(),
                                   model.cameras.size(), model.points.size());
    if (!model.frames.empty())
      text += fmt::format(", {} frames of {} rigs", model.frames.size(), model.rigs.size());
    add(Level::good, "model", text);
    if (model.images.size() < kFewPhotos)
      add(Level::warning, "model",
          fmt::format(
              "{} photos are few: what only one of them shows cannot be learned; take more, "
              "overlapping by two thirds",
              model.images.size()));
    if (config_.dataset.eval)
      add(Level::good, "model",
          fmt::format("{} photos are held out to measure on",
                      std::count(read.is_test.begin(), read.is_test.end(), true)));
    return true;
  }

  void match_photos_to_names() {
    std::vector<std::string> names;
    for (const ColmapImage& image : scene_.model.images) names.push_back(image.name);
    scene_.files = match_photos(names, scene_.folders.images);
    std::vector<std::size_t> missing;
    for (std::size_t i = 0; i < names.size(); ++i)
      if (scene_.files[i].empty()) missing.push_back(i);
    const std::vector<std::string> unused = pictures_besides(scene_.files, scene_.folders.images);
    if (missing.empty())
      add(Level::good, "photos", fmt::format("all {} photos of the model are there", names.size()));
    else
      add(Level::fatal, "photos",
          fmt::format(
              "{} of the model's {} photos are not in {}; copy them there, or name another folder "
              "with --set dataset.images=FOLDER",
              missing.size(), names.size(), scene_.folders.images.string()),
          names_of(missing));
    if (!unused.empty())
      add(unused.size() > names.size() ? Level::warning : Level::note, "photos",
          fmt::format("{} photos there are not in the model: COLMAP could not place them, or never "
                      "saw them",
                      unused.size()),
          unused);
  }

  void match_masks_to_photos() {
    const std::size_t count = scene_.files.size();
    scene_.mask_files.resize(count);
    std::vector<std::string> names;
    std::vector<fs::path> of_model;
    for (const ColmapImage& image : scene_.model.images) {
      names.push_back(image.name);
      of_model.push_back(image.mask);
    }
    try {
      scene_.masks = find_masks(config_.dataset, scene_.folders);
      scene_.mask_files = match_masks(scene_.masks, names, scene_.files, of_model);
    } catch (const Error& error) {
      add(Level::fatal, "masks", error.what());
      return;
    }
    std::vector<std::size_t> missing;
    for (std::size_t i = 0; i < count; ++i)
      if (scene_.mask_files[i].empty()) missing.push_back(i);
    if (missing.size() == count) return;
    add(Level::good, "masks",
        fmt::format("{} of {} photos have a mask in {}", count - missing.size(), count,
                    scene_.masks.folder.string()));
    if (!missing.empty())
      add(Level::warning, "masks",
          fmt::format("{} photos have no mask there and train everywhere, but for their alpha",
                      missing.size()),
          names_of(missing));
  }

  // `shares` of the pixels that train, of the photos `readable`; 1 where there is no mask.
  void report_masks(const std::vector<std::size_t>& readable, const std::vector<double>& shares) {
    std::vector<std::size_t> masked, hardly;
    double sum = 0;
    for (std::size_t k = 0; k < readable.size(); ++k) {
      if (shares[k] >= 1) continue;
      masked.push_back(readable[k]);
      sum += shares[k];
      if (shares[k] < kHardlyTrained) hardly.push_back(readable[k]);
    }
    if (masked.empty()) return;
    masked_share_ = double(masked.size()) / double(readable.size());
    const bool is_background = scene_.masks.over_background;
    add(Level::good, "masks",
        fmt::format("{} of {} photos are masked; {:.1f} % of their pixels {}", masked.size(),
                    readable.size(), 100 * sum / double(masked.size()),
                    is_background ? "show the scene, the others its background" : "train"));
    if (!hardly.empty())
      add(Level::warning, "masks",
          fmt::format("{} masks leave less than {:.0f} % of their photo; if black is what should "
                      "train, turn them round with --invert-masks",
                      hardly.size(), 100 * kHardlyTrained),
          names_of(hardly));
    if (!is_background && sum == 0 && masked.size() == scene_.files.size())
      add(Level::fatal, "masks",
          "no photo has a pixel to train on; turn the masks round with --invert-masks");
  }

  void read_headers() {
    const std::size_t count = scene_.files.size();
    scene_.photo_sizes.resize(count);
    std::vector<std::string> errors(count);
    std::vector<int> orientations(count, 1);
    parallel_for(count, 8, [&](std::size_t i) {
      if (scene_.files[i].empty()) return;
      try {
        scene_.photo_sizes[i] = read_photo_size(scene_.files[i]);
        orientations[i] = read_photo_orientation(scene_.files[i]);
      } catch (const Error& error) {
        errors[i] = error.what();
      }
    });
    std::vector<std::size_t> unreadable, turned, other, scaled, with_orientation;
    for (std::size_t i = 0; i < count; ++i) {
      if (scene_.files[i].empty()) continue;
      if (!errors[i].empty()) {
        unreadable.push_back(i);
        continue;
      }
      const ColmapCamera& camera = scene_.model.cameras.at(scene_.model.images[i].camera_id);
      const PhotoFit fit = fit_of(scene_.photo_sizes[i], {camera.width, camera.height});
      if (fit == PhotoFit::turned) turned.push_back(i);
      if (fit == PhotoFit::other) other.push_back(i);
      if (fit == PhotoFit::fits && scene_.photo_sizes[i].width != camera.width) scaled.push_back(i);
      if (orientations[i] != 1) with_orientation.push_back(i);
      if (fit == PhotoFit::fits) scene_.usable.push_back(i);
    }
    report_lenses();
    if (!unreadable.empty())
      add(Level::fatal, "photos",
          fmt::format(
              "{} photos cannot be read ({}); fetch them again, or leave them out of the model",
              unreadable.size(), errors[unreadable.front()]),
          names_of(unreadable));
    if (!turned.empty())
      add(Level::fatal, "orientation",
          fmt::format("{} photos lie on their side against the model: their EXIF orientation was "
                      "followed once and "
                      "ignored once; turn the pixels themselves (`mogrify -auto-orient` on copies) "
                      "and give COLMAP and "
                      "gemsplat these same files",
                      turned.size()),
          names_of(turned));
    else if (!with_orientation.empty())
      add(Level::note, "orientation",
          fmt::format("{} photos ask viewers to turn them (EXIF); COLMAP and gemsplat take the "
                      "pixels as they are stored, "
                      "so the trained scene fits, but other programs may turn them",
                      with_orientation.size()),
          names_of(with_orientation));
    if (!other.empty())
      add(Level::fatal, "photos",
          fmt::format("{} photos have another shape than their camera in the model: they are not "
                      "what COLMAP saw; use the "
                      "same photos, or run COLMAP again",
                      other.size()),
          names_of(other));
    if (!scaled.empty())
      add(Level::note, "photos",
          fmt::format("{} photos have another size than their camera in the model; its intrinsics "
                      "are scaled",
                      scaled.size()));
  }

  void report_lenses() {
    std::map<std::string, int> counts;
    std::string refused;
    for (const auto& [id, camera] : scene_.model.cameras) {
      ++counts[fmt::format("{} {}x{}", camera_model_info(camera.model).name, camera.width,
                           camera.height)];
      try {
        undistorted_pinhole(lens_camera(camera, fmt::format("of camera {}", id)),
                            fmt::format("of camera {}", id));
      } catch (const Error& error) {
        if (refused.empty()) refused = error.what();
      }
    }
    std::string text;
    for (const auto& [lens, count] : counts)
      text +=
          (text.empty() ? "" : ", ") + (count > 1 ? fmt::format("{} times {}", count, lens) : lens);
    add(Level::good, "lenses", text);
    if (!refused.empty()) add(Level::fatal, "lenses", refused);
  }

  void look_at_all_pictures() {
    const std::size_t count = scene_.usable.size();
    std::vector<PictureQuality> qualities(count);
    std::vector<double> shares(count, 1);
    std::vector<std::string> errors(count);
    std::mutex mutex;
    std::size_t done = 0;
    parallel_for(count, 1, [&](std::size_t k) {
      try {
        const std::size_t i = scene_.usable[k];
        const PhotoWithAlpha read = read_photo_with_alpha(scene_.files[i]);
        qualities[k] = quality_of(read.photo);
        shares[k] = trained_share(read_mask(scene_.masks, scene_.mask_files[i], read));
      } catch (const Error& error) {
        errors[k] = error.what();
      }
      const std::lock_guard lock(mutex);
      if (progress_) progress_(++done, count);
    });
    std::vector<std::size_t> damaged, readable;
    std::vector<PictureQuality> of_readable;
    std::vector<double> readable_shares;
    for (std::size_t k = 0; k < count; ++k) {
      if (!errors[k].empty()) {
        damaged.push_back(scene_.usable[k]);
        continue;
      }
      readable.push_back(scene_.usable[k]);
      of_readable.push_back(qualities[k]);
      readable_shares.push_back(shares[k]);
    }
    if (!damaged.empty())
      add(Level::fatal, "photos",
          fmt::format(
              "{} photos or masks are damaged; fetch them again, or leave them out of the model",
              damaged.size()),
          names_of(damaged));
    report_masks(readable, readable_shares);
    const QualityOutliers outliers = outliers_of(of_readable);
    const auto named = [&](const std::vector<std::size_t>& which) {
      std::vector<std::size_t> images;
      for (const std::size_t k : which) images.push_back(readable[k]);
      return names_of(images);
    };
    if (outliers.blurred.empty() && outliers.odd_exposure.empty())
      add(Level::good, "pictures",
          "none is much less sharp or much darker or brighter than the others");
    if (!outliers.blurred.empty())
      add(Level::warning, "pictures",
          fmt::format("{} photos are far less sharp than the others; without them the scene may "
                      "come out sharper",
                      outliers.blurred.size()),
          named(outliers.blurred));
    if (!outliers.odd_exposure.empty())
      add(Level::warning, "pictures",
          fmt::format("{} photos are far darker or brighter than the others; colors there will be "
                      "a compromise",
                      outliers.odd_exposure.size()),
          named(outliers.odd_exposure));
  }

  void examine_cameras() {
    std::vector<View> views;
    std::vector<Camera> cameras;
    for (const ColmapImage& image : scene_.model.images) {
      View view;
      PinholeCamera<double> camera;
      camera.cam_from_world_rotation = rotation_matrix(image.cam_from_world_rotation);
      camera.cam_from_world_translation = image.cam_from_world_translation;
      view.camera = camera_as<float>(camera);
      view.name = image.name;
      views.push_back(std::move(view));
      cameras.push_back(views.back().camera);
    }
    std::vector<std::string> outliers;
    for (const std::size_t i : outlier_cameras(views)) outliers.push_back(views[i].name);
    if (!outliers.empty())
      add(Level::warning, "cameras",
          fmt::format("{} cameras stand far away from all others; their poses are probably wrong, "
                      "leave these photos out",
                      outliers.size()),
          outliers);
    add(Level::good, "place",
        fmt::format("the cameras span {:.3g} world units", camera_extent(views)));
    const SceneFrame frame = scene_frame(cameras, {});
    if (!cameras.empty() && frame.up_spread < kUpSpread)
      add(Level::good, "place",
          fmt::format("up is about ({:.2f}, {:.2f}, {:.2f}), as most cameras are held", frame.up.x,
                      frame.up.y, frame.up.z));
    else
      add(Level::note, "place",
          "the cameras are held in all directions: nothing says which way is up");
    if (scene_.world_offset != Vec3d(0.0))
      add(Level::note, "place",
          fmt::format("the scene lies far from the origin, where single precision loses detail: it "
                      "is trained with {} taken "
                      "off its coordinates",
                      text_of_offset(scene_.world_offset)));
  }

  void examine_points() {
    const std::vector<ColmapPoint>& points = scene_.model.points;
    if (points.empty()) {
      add(Level::warning, "points",
          fmt::format("the model has no points: {} random ones are started from, which takes "
                      "longer and ends worse",
                      config_.model.random_points));
      return;
    }
    double error = 0, observations = 0;
    std::size_t few = 0;
    for (const ColmapPoint& point : points) {
      error += point.error;
      observations += double(point.observations);
      few += point.observations < kFewObservations;
    }
    const double count = double(points.size());
    add(Level::good, "points",
        fmt::format("mean reprojection error {:.2f} pixels, each seen in {:.1f} photos in the mean",
                    error / count, observations / count));
    if (error / count > kLargeError)
      add(Level::warning, "points",
          "that error is large: poses or lens are not right, and pictures will be soft; try "
          "another "
          "--camera-model, or `colmap bundle_adjuster`");
    if (2 * few > points.size() && observations > 0)
      add(Level::note, "points",
          fmt::format("{} of {} points were seen in fewer than {} photos", few, points.size(),
                      kFewObservations));
    if (points.size() > std::size_t(config_.model.most_points))
      add(Level::note, "points",
          fmt::format("{} points are more than model.most_points: {} of them are taken",
                      points.size(), config_.model.most_points));
  }

  // Whatever else load_scene() would refuse.
  void check_the_rest() {
    if (!diagnosis_.can_train()) return;
    try {
      check_scene(config_.dataset);
    } catch (const Error& error) {
      add(Level::fatal, "scene", error.what());
    }
  }

  void forecast() {
    double pixels = 0;
    for (const std::size_t i : scene_.usable) {
      const double all = double(scene_.photo_sizes[i].width) * scene_.photo_sizes[i].height;
      const int resolution = config_.dataset.resolution;
      const double scale =
          resolution <= 8 ? 1.0 / resolution : double(resolution) / scene_.photo_sizes[i].width;
      pixels += all * std::min(scale * scale, 1.0);
    }
    const double megapixels =
        pixels * 1e-6 / double(std::max<std::size_t>(scene_.usable.size(), 1));
    add(Level::note, "forecast", gs::forecast(config_, (3 + masked_share_) * pixels, megapixels));
  }

  const Config& config_;
  const ProgressFn& progress_;
  FoundScene scene_;
  double masked_share_ = 0;  // of the photos
  Diagnosis diagnosis_;
};

}  // namespace

bool Diagnosis::can_train() const {
  return std::none_of(findings.begin(), findings.end(),
                      [](const Finding& finding) { return finding.level == Level::fatal; });
}

Diagnosis examine(const Config& config, bool look_at_pictures, const ProgressFn& progress) {
  return Examination(config, progress).run(look_at_pictures);
}

}  // namespace gs
