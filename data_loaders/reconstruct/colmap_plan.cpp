// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/colmap_plan.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <utility>

#include "data_loaders/reconstruct/colmap_commands.h"
#include "gs_core/error.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/fnv1a.h"
#include "gs_core/system/processes/subprocess.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// With more, `auto` does not match all pairs; COLMAP's automatic_reconstructor has the same limit.
constexpr std::size_t kExhaustivePhotos = 200, kExhaustivePanoramas = 100;

std::string found_program(const ColmapPlan& plan, const std::string& name) {
  const auto program = find_program(name);
  if (!program)
    throw Error(fmt::format(
        "cannot find the program {}, which finds where photos were taken; install it (Debian, "
        "Ubuntu: apt install colmap) or name it with {}",
        name, plan.flag("colmap", "PATH")));
  return program->string();
}

// The same size, whichever way the camera was held.
bool same_size(const std::vector<PhotoFile>& photos) {
  const auto sides = [](const PhotoFile& photo) {
    return std::minmax(photo.size.width, photo.size.height);
  };
  return std::all_of(photos.begin(), photos.end(),
                     [&](const PhotoFile& photo) { return sides(photo) == sides(photos[0]); });
}

/// The photos whose cameras are known, as they are stored: the cameras are of those pixels.
std::vector<PhotoFile> posed_photos(const ColmapModel& poses, const fs::path& folder) {
  std::vector<PhotoFile> photos;
  for (const ColmapImage& image : poses.images) {
    const fs::path name = fs::path(image.name).lexically_normal();
    if (name.is_absolute() || name.empty() || *name.begin() == "..")
      throw Error(fmt::format("the image name '{}' leads out of {}; rename it in the model",
                              image.name, folder.string()));
    const PhotoFile photo{folder / image.name, image.name, read_photo_size(folder / image.name)};
    const ColmapCamera& camera = poses.cameras.at(image.camera_id);
    if (photo.size.width != camera.width || photo.size.height != camera.height)
      throw Error(fmt::format(
          "photo {} has {} x {} pixels, but its camera in the model {} x {}; "
          "make them the same with `gemsplat undistort`, and take what it writes",
          photo.path.string(), photo.size.width, photo.size.height, camera.width, camera.height));
    photos.push_back(photo);
  }
  return photos;
}

/// A text that differs where a pose or a camera does.
std::string text_of_poses(const ColmapModel& poses) {
  Fnv1a hash;
  for (const auto& [id, camera] : poses.cameras)
    for (const double value : camera.params) hash.add(fmt::format("{} {}\n", id, value));
  for (const ColmapImage& image : poses.images) {
    const auto& [w, x, y, z] = image.cam_from_world_rotation;
    const Vec3d& t = image.cam_from_world_translation;
    hash.add(fmt::format("{} {} {} {} {} {} {} {} {}\n", image.name, image.camera_id, w, x, y, z,
                         t.x, t.y, t.z));
  }
  return fmt::format(", known poses {:016x}", hash.value());
}

}  // namespace

std::string ColmapPlan::flag(std::string_view key, std::string_view value) const {
  if (!has_short_flags) return fmt::format("--set reconstruct.{}={}", key, value);
  std::string name(key);
  std::replace(name.begin(), name.end(), '_', '-');
  return fmt::format("--{} {}", name, value);
}

void complete_plan(ColmapPlan& plan, const fs::path& source) {
  if (plan.photos.size() < kFewestPhotos)
    throw Error(
        fmt::format("{} has {} photo(s); a scene needs at least {}, and looks good with 30 or more",
                    source.string(), plan.photos.size(), kFewestPhotos));
  const std::size_t most = plan.has_panoramas() ? kExhaustivePanoramas : kExhaustivePhotos;
  if (plan.matching == Matching::automatic)
    plan.matching = !plan.videos.empty()         ? Matching::sequential
                    : plan.photos.size() <= most ? Matching::exhaustive
                                                 : Matching::retrieval;
  plan.single_camera = plan.single_camera_setting == SingleCamera::automatic
                           ? same_size(plan.photos)
                           : plan.single_camera_setting == SingleCamera::yes;
}

ColmapPlan plan_of(const ColmapJob& job) {
  const ReconstructConfig& settings = job.settings;
  ColmapPlan plan;
  plan.files.root = job.scene;
  plan.matching = settings.matching;
  plan.mapper = settings.mapper;
  plan.single_camera_setting = settings.single_camera;
  plan.camera_model = settings.camera_model;
  plan.max_features = settings.max_features;
  plan.frames = settings.frames;
  plan.use_gpu = settings.use_gpu;
  plan.threads = job.threads;
  plan.poses = job.poses;
  if (!plan.poses) plan.videos = find_videos(job.photos);
  plan.has_short_flags = job.has_short_flags;
  plan.program = found_program(plan, settings.colmap);
  if (plan.mapper == Mapper::global && !has_command(plan, kGlobalMapper))
    throw Error(fmt::format(
        "{} has no command {}, which COLMAP 4 has; name such a program with {}, or take {}",
        plan.program, kGlobalMapper, plan.flag("colmap", "PATH"),
        plan.flag("mapper", "incremental")));
  const bool same_folder = fs::weakly_canonical(job.photos) == fs::weakly_canonical(job.scene);
  if (!plan.videos.empty()) {
    if (same_folder)
      throw UsageError("the videos and the scene are in the same folder, " + job.photos.string() +
                       "; name another for the scene with -o");
    return plan;
  }
  if (same_folder && !fs::is_directory(plan.files.images()))
    throw UsageError("the photos and the scene are the same folder, " + job.photos.string() +
                     "; name another for the scene with -o, or put the photos into its images/");
  const fs::path photos = same_folder ? plan.files.images() : job.photos;
  plan.photos_in_place = is_within(photos, plan.files.images());
  plan.photos = plan.poses
                    ? posed_photos(*plan.poses, photos)
                    : find_photos(photos, job.scene,
                                  plan.photos_in_place ? PhotoUse::in_place : PhotoUse::brought);
  if (plan.photos_in_place && !is_within(plan.files.images(), photos))
    throw UsageError(fmt::format("{} lies inside the images of {}; choose another scene with -o",
                                 photos.string(), job.scene.string()));
  complete_plan(plan, job.photos);
  return plan;
}

std::vector<std::vector<PhotoFile>> camera_groups(const ColmapPlan& plan) {
  if (!plan.single_camera) return {plan.photos};
  std::map<std::pair<int, int>, std::vector<PhotoFile>> by_size;
  for (const PhotoFile& photo : plan.photos)
    by_size[{photo.size.width, photo.size.height}].push_back(photo);
  std::vector<std::vector<PhotoFile>> groups;
  for (auto& [size, photos] : by_size) groups.push_back(std::move(photos));
  return groups;
}

std::string made_of(const ColmapPlan& plan) {
  Fnv1a hash;
  for (const fs::path& video : plan.videos)
    hash.add(fmt::format("{}\n{}\n", video.filename().string(), fs::file_size(video)));
  // `auto` has no text, so that a scene stays finished when COLMAP is replaced by a newer one.
  const std::string mapper =
      plan.mapper == Mapper::automatic ? "" : fmt::format(", {} mapper", word_of(plan.mapper));
  if (!plan.videos.empty())
    return fmt::format(
        "{} frames of {} videos {:016x}, {}, {} camera(s), {} matching, {} features{}", plan.frames,
        plan.videos.size(), hash.value(), plan.camera_model, word_of(plan.single_camera_setting),
        word_of(plan.matching), plan.max_features, mapper);
  for (const PhotoFile& photo : plan.photos)
    hash.add(fmt::format("{}\n{}\n{}", photo.name, fs::file_size(photo.path),
                         photo.is_copied ? "upright\n" : ""));
  return fmt::format("{} photos {:016x}, {}, {} camera(s), {} matching, {} features{}{}",
                     plan.photos.size(), hash.value(), plan.camera_model,
                     plan.has_panoramas() ? "views of panoramas, no"
                     : plan.single_camera ? "one"
                                          : "own",
                     word_of(plan.matching), plan.max_features, mapper,
                     plan.poses ? text_of_poses(*plan.poses) : "");
}

}  // namespace gs
