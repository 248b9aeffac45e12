// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/reconstruct/panorama_views.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <mutex>
#include <numbers>
#include <set>

#include "data_loaders/lenses/hemispheres.h"
#include "data_loaders/photos/encode/encode_jpeg.h"
#include "data_loaders/photos/orientation.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/text/json.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr int kLargestView = 1600;         // pixels a side
constexpr int kViewQuality = 95;           // of JPEG
constexpr double kSameTurn = 0.9990;       // cosine of half the angle between turns: 5 degrees
constexpr const char* kRigFolder = "{}/";  // of a view's pictures

/// Turns directions of a panorama into the frame of one of its views.
Quat<double> view_from_panorama(int view) {
  const double half_turn = -view * std::numbers::pi / kPanoramaViews;
  return {std::cos(half_turn), 0, std::sin(half_turn), 0};
}

/// As sharp as the largest panorama.
int side_of_views(const ColmapPlan& plan) {
  int width = 0;
  for (const PhotoFile& photo : plan.photos) width = std::max(width, photo.size.width);
  return std::clamp(int(width / std::numbers::pi), 1, kLargestView);
}

PinholeCamera<double> camera_of_view(int side, int view) {
  PinholeCamera<double> camera;
  camera.width = camera.height = side;
  camera.fx = camera.fy = camera.cx = camera.cy = side / 2.0;
  camera.cam_from_world_rotation = rotation_matrix(view_from_panorama(view));
  return camera;
}

/// Where a view belongs, by its name.
struct ViewName {
  std::size_t panorama;
  int view;
};
ViewName parsed(const std::string& name) {
  ViewName result{};
  const char* const end = name.data() + name.size();
  const auto view = std::from_chars(name.data(), end, result.view);
  const auto panorama = std::from_chars(std::min(view.ptr + 1, end), end, result.panorama);
  if (view.ec != std::errc() || panorama.ec != std::errc())
    throw Error(
        fmt::format("the model of COLMAP has an image '{}', which is no view of a "
                    "panorama; reconstruct into another folder with -o",
                    name));
  return result;
}

struct PanoramaPose {
  Quat<double> rotation;  // of the panorama, by one view
  Vec3d center;           // of the view
  const ColmapImage* image;
  int view;
};

PanoramaPose pose_of_panorama(const ColmapImage& image, int view) {
  const Quat<double> turn = view_from_panorama(view);
  const Vec3d center = -multiply_transposed(rotation_matrix(image.cam_from_world_rotation),
                                            image.cam_from_world_translation);
  return {product({turn.w, -turn.x, -turn.y, -turn.z}, image.cam_from_world_rotation), center,
          &image, view};
}

double cosine(const Quat<double>& a, const Quat<double>& b) {
  return a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z;
}

/// Those that agree with the one with which most agree.
std::vector<PanoramaPose> agreeing(const std::vector<PanoramaPose>& poses) {
  std::vector<PanoramaPose> best;
  for (const PanoramaPose& middle : poses) {
    std::vector<PanoramaPose> near;
    for (const PanoramaPose& pose : poses)
      if (std::abs(cosine(pose.rotation, middle.rotation)) > kSameTurn) near.push_back(pose);
    if (near.size() > best.size()) best = std::move(near);
  }
  return best;
}

/// The mean by the number of observations, with the observations of all views; a point that two of
/// them see counts once.
ColmapImage joined_views(const std::vector<PanoramaPose>& poses, const ColmapModel& of_views,
                         const PhotoSize& size) {
  Quat<double> rotation{0, 0, 0, 0};
  Vec3d center(0.0);
  double sum = 0;
  for (const PanoramaPose& pose : poses) {
    const double weight = 1 + double(pose.image->observations.size());
    const double signed_weight = cosine(pose.rotation, poses[0].rotation) < 0 ? -weight : weight;
    rotation = {
        rotation.w + signed_weight * pose.rotation.w, rotation.x + signed_weight * pose.rotation.x,
        rotation.y + signed_weight * pose.rotation.y, rotation.z + signed_weight * pose.rotation.z};
    center += weight * pose.center;
    sum += weight;
  }
  center /= sum;
  const double norm = std::sqrt(cosine(rotation, rotation));
  ColmapImage joined;
  joined.cam_from_world_rotation = {rotation.w / norm, rotation.x / norm, rotation.y / norm,
                                    rotation.z / norm};
  joined.cam_from_world_translation =
      -multiply(rotation_matrix(joined.cam_from_world_rotation), center);
  std::set<std::uint64_t> seen;
  for (const PanoramaPose& pose : poses) {
    const int side = of_views.cameras.at(pose.image->camera_id).width;
    const Mat3<double> turn = rotation_matrix(view_from_panorama(pose.view));
    for (const ColmapObservation& at : pose.image->observations) {
      if (!seen.insert(at.point_id).second) continue;
      const Vec3d ray =
          multiply_transposed(turn, Vec3d(at.x / side * 2 - 1, at.y / side * 2 - 1, 1));
      const Vec2d pixel = panorama_pixel(ray, size.width, size.height);
      joined.observations.push_back({at.point_id, pixel.x, pixel.y});
    }
  }
  return joined;
}

Json numbers_of(const Quat<double>& q) { return {q.w, q.x, q.y, q.z}; }

void write_rig(const fs::path& file, const Json& rig) {
  AtomicFile out(file);
  out.write(file_text(Json::array({rig})));
  out.commit();
}

}  // namespace

std::vector<PhotoFile> panorama_views(const ColmapPlan& plan) {
  const int side = side_of_views(plan);
  std::vector<PhotoFile> views;
  for (int view = 0; view < kPanoramaViews; ++view)
    for (std::size_t i = 0; i < plan.photos.size(); ++i) {
      const std::string name = fmt::format("{}/{:05}.jpg", view, i);
      views.push_back({plan.files.views() / name, name, {side, side}});
    }
  return views;
}

std::string panorama_view_params(const ColmapPlan& plan) {
  const double half = side_of_views(plan) / 2.0;
  return fmt::format("{0},{0},{0},{0}", half);
}

void cut_panoramas(const ColmapPlan& plan, const ColmapProgress& progress) {
  const std::vector<PhotoFile> views = panorama_views(plan);
  const std::size_t count = plan.photos.size();
  const auto total = std::int64_t(count);
  progress(ColmapStage::copies, 0, total);
  std::mutex mutex;
  std::int64_t done = 0;
  parallel_for(count, 1, [&](std::size_t i) {
    Image8 panorama;
    for (int view = 0; view < kPanoramaViews; ++view) {
      const PhotoFile& to = views[std::size_t(view) * count + i];
      if (fs::exists(to.path)) continue;
      if (panorama.empty())
        panorama = evened_panorama(read_upright(plan.files.photos() / plan.photos[i].name));
      const std::vector<std::uint8_t> bytes = encode_jpeg_alone(
          pinhole_of(panorama, camera_of_view(to.size.width, view), plan.photos[i].name),
          kViewQuality);
      AtomicFile file(to.path);
      file.write(bytes.data(), bytes.size());
      file.commit();
    }
    const std::lock_guard lock(mutex);
    progress(ColmapStage::copies, ++done, total);
  });
}

void write_rig_of_views(const fs::path& file) {
  Json cameras = Json::array();
  for (int view = 0; view < kPanoramaViews; ++view) {
    Json camera = {{"image_prefix", fmt::format(kRigFolder, view)}};
    if (view == 0) {
      camera["ref_sensor"] = true;
    } else {
      camera["cam_from_rig_rotation"] = numbers_of(view_from_panorama(view));
      camera["cam_from_rig_translation"] = {0, 0, 0};
    }
    cameras.push_back(camera);
  }
  write_rig(file, {{"cameras", cameras}});
}

void write_rig_of_views(const fs::path& file, const ColmapModel& of_views) {
  std::map<int, std::uint32_t> camera_of;
  for (const ColmapImage& image : of_views.images)
    camera_of[parsed(image.name).view] = image.camera_id;
  Json cameras = Json::array();
  for (const auto& [view, camera_id] : camera_of)
    cameras.push_back({{"camera_id", camera_id},
                       {"image_prefix", fmt::format(kRigFolder, view)},
                       {"rel_qvec", numbers_of(view_from_panorama(view))},
                       {"rel_tvec", {0, 0, 0}}});
  write_rig(file, {{"ref_camera_id", camera_of.begin()->second}, {"cameras", cameras}});
}

ColmapModel panorama_model(const ColmapPlan& plan, const ColmapModel& of_views) {
  std::map<std::size_t, std::vector<PanoramaPose>> poses;
  for (const ColmapImage& image : of_views.images) {
    const ViewName name = parsed(image.name);
    if (name.panorama < plan.photos.size())
      poses[name.panorama].push_back(pose_of_panorama(image, name.view));
  }
  ColmapModel model;
  std::map<std::pair<int, int>, std::uint32_t> camera_of_size;
  for (const auto& [panorama, all] : poses) {
    const PhotoFile& photo = plan.photos[panorama];
    const auto& [width, height] = photo.size;
    const auto next = std::uint32_t(camera_of_size.size() + 1);
    const std::uint32_t id = camera_of_size.try_emplace({width, height}, next).first->second;
    model.cameras[id] = {
        id, CameraModel::equirectangular, width, height, {double(width), double(height)}};
    ColmapImage image = joined_views(agreeing(all), of_views, photo.size);
    image.id = std::uint32_t(panorama + 1);
    image.name = photo.name;
    image.camera_id = id;
    model.images.push_back(std::move(image));
  }
  model.points = of_views.points;
  return model;
}

}  // namespace gs
