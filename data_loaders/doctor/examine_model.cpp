// SPDX-License-Identifier: Apache-2.0
// The parts of an examination that look at the model: folders, lenses, cameras, points.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>

#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/doctor/examination.h"
#include "data_loaders/lenses/lens_range.h"
#include "data_loaders/scene/photo_times.h"
#include "gs_core/error.h"
#include "gs_core/geometry/scene_frame.h"
#include "gs_core/geometry/scene_sight.h"
#include "gs_core/math/render/rotation.h"

namespace gs {
namespace {

using Level = Finding::Level;

constexpr std::size_t kFewObservations = 3;  // points seen in fewer photos are unreliable
constexpr double kLargeError = 2;            // pixels, mean reprojection error

/// The name of a photo for each camera that has one; cameras without photos do no harm.
std::map<std::uint32_t, std::string> photo_of_each_camera(const ColmapModel& model) {
  std::map<std::uint32_t, std::string> photos;
  for (const ColmapImage& image : model.images) photos.try_emplace(image.camera_id, image.name);
  return photos;
}

std::vector<View> cameras_of(const ColmapModel& model) {
  std::vector<View> views;
  for (const ColmapImage& image : model.images) {
    PinholeCamera<double> camera;
    camera.cam_from_world_rotation = rotation_matrix(image.cam_from_world_rotation);
    camera.cam_from_world_translation = image.cam_from_world_translation;
    View view;
    view.camera = camera_as<float>(camera);
    view.name = image.name;
    views.push_back(std::move(view));
  }
  return views;
}

/// The cameras that training would use, at their full size; without those whose lens is refused.
std::vector<Camera> training_cameras(const Examination& examination) {
  const ColmapModel& model = examination.model();
  std::vector<Camera> cameras;
  std::map<std::uint32_t, PinholeCamera<double>> pinholes;  // a search over all borders: once each
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    const ColmapImage& image = model.images[i];
    if (examination.scene.photos[i].is_test) continue;
    try {
      if (!pinholes.contains(image.camera_id))
        pinholes[image.camera_id] =
            trained_camera(lens_camera(model.cameras.at(image.camera_id), image.name),
                           examination.config.dataset.lens, image.name);
      PinholeCamera<double> camera = pinholes.at(image.camera_id);
      camera.cam_from_world_rotation = rotation_matrix(image.cam_from_world_rotation);
      camera.cam_from_world_translation = image.cam_from_world_translation;
      cameras.push_back(camera_as<float>(camera));
    } catch (const Error&) {  // examine_lenses() says so
    }
  }
  return cameras;
}

/// Says how the cameras are held: training does not need it, but viewers do.
void examine_up(Examination& examination, const std::vector<View>& views) {
  std::vector<Camera> cameras;
  for (const View& view : views) cameras.push_back(view.camera);
  const SceneFrame frame = scene_frame(cameras, {});
  if (frame.up_is_known)
    examination.add(Level::good, "place",
                    fmt::format("up is about ({:.2f}, {:.2f}, {:.2f}), as most cameras are held",
                                frame.up.x, frame.up.y, frame.up.z));
  else
    examination.add(Level::note, "place",
                    "the cameras are held in all directions or lie on their side, so the up "
                    "direction is unknown: `gemsplat edit --up X,Y,Z` turns the trained model");
}

}  // namespace

bool find_folders(Examination& examination) {
  try {
    examination.scene.folders = find_scene(examination.config.dataset);
  } catch (const Error& error) {
    examination.add(Level::fatal, "scene", error.what());
    return false;
  }
  examination.add(Level::good, "scene",
                  fmt::format("model in {}, photos in {}", examination.scene.folders.model.string(),
                              examination.scene.folders.images.string()));
  return true;
}

bool read_model(Examination& examination) {
  SceneModel& scene = examination.scene;
  try {
    scene = read_scene(examination.config.dataset, examination.scene.folders);
    find_times(examination.config.dataset, scene);
    move_near_origin(scene);
  } catch (const Error& error) {
    examination.add(Level::fatal, "model", error.what());
    return false;
  }
  const ColmapModel& model = scene.model;
  std::string text =
      fmt::format("{} placed, {}, {}", counted(model.images.size(), "photo"),
                  counted(model.cameras.size(), "camera"), counted(model.points.size(), "point"));
  if (!model.frames.empty())
    text += fmt::format(", {} of {}", counted(model.frames.size(), "frame"),
                        counted(model.rigs.size(), "rig"));
  examination.add(Level::good, "model", text);
  if (scene.moves() && !examination.config.model.dynamic)
    examination.add(Level::warning, "model", text_of_moving_scene(scene.time_count));
  if (model.images.size() < kFewPhotos)
    examination.add(Level::warning, "model",
                    fmt::format("{}: training needs every place in several photos; take more, "
                                "overlapping by two thirds",
                                counted(model.images.size(), "photo", "is not enough", "are few")));
  if (examination.config.dataset.eval) {
    const auto held_out = std::size_t(std::ranges::count_if(scene.photos, &Photo::is_test));
    examination.add(
        Level::good, "model",
        fmt::format("{} held out to measure on", counted(held_out, "photo", "is", "are")));
  }
  return true;
}

void examine_lenses(Examination& examination) {
  std::map<std::string, std::size_t> counts;
  std::string refused;
  for (const auto& [id, photo] : photo_of_each_camera(examination.model())) {
    const ColmapCamera& camera = examination.model().cameras.at(id);
    ++counts[fmt::format("{} {}x{}", camera_model_info(camera.model).name, camera.width,
                         camera.height)];
    try {
      trained_camera(lens_camera(camera, photo), examination.config.dataset.lens, photo);
    } catch (const Error& error) {
      if (refused.empty()) refused = error.what();
    }
  }
  std::string text;
  for (const auto& [lens, count] : counts)
    text +=
        (text.empty() ? "" : ", ") + (count > 1 ? fmt::format("{} times {}", count, lens) : lens);
  examination.add(Level::good, "lenses", text);
  const auto moving = std::size_t(std::ranges::count_if(
      examination.model().images, [](const ColmapImage& image) { return image.motion.is_any(); }));
  if (moving > 0)
    examination.add(Level::good, "lenses",
                    fmt::format("{} seen row by row, from a pose for the first and the last row",
                                counted(moving, "photo", "is", "are")));
  if (!refused.empty()) examination.add(Level::fatal, "lenses", refused);
}

void examine_cameras(Examination& examination) {
  const std::vector<View> views = cameras_of(examination.model());
  std::vector<std::string> outliers;
  for (const std::size_t i : outlier_cameras(views)) outliers.push_back(views[i].name);
  if (!outliers.empty())
    examination.add(
        Level::warning, "cameras",
        fmt::format(
            "{} far away from all others, probably because of a wrong pose; leave the photos out",
            counted(outliers.size(), "camera", "stands", "stand")),
        outliers);
  examination.add(Level::good, "place",
                  fmt::format("the cameras span {:.3g} world units", camera_extent(views)));
  examine_up(examination, views);
  if (examination.scene.world_offset != Vec3d(0.0))
    examination.add(Level::note, "place",
                    fmt::format("the scene lies far from the origin, where single precision loses "
                                "detail: {} is subtracted from its coordinates for training",
                                text_of_offset(examination.scene.world_offset)));
}

void examine_points(Examination& examination) {
  const std::vector<ColmapPoint>& points = examination.model().points;
  const ModelConfig& model = examination.config.model;
  if (points.empty()) {
    examination.add(Level::warning, "points", text_of_no_points(model.random_points));
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
  examination.add(Level::good, "points",
                  fmt::format("mean reprojection error {:.2f} pixels, {:.1f} photos per point",
                              error / count, observations / count));
  if (error / count > kLargeError)
    examination.add(Level::warning, "points",
                    "that error is large: poses or lens are inaccurate, and pictures will be soft; "
                    "try another --camera-model with `gemsplat reconstruct`, `colmap "
                    "bundle_adjuster`, or training with --set poses.refine=true, which also "
                    "learns the poses (docs/method/poses.md)");
  if (2 * few > points.size() && observations > 0)
    examination.add(Level::note, "points",
                    fmt::format("{} of {} points were seen in fewer than {} photos", few,
                                points.size(), kFewObservations));
  if (points.size() > std::size_t(kMostPoints))
    examination.add(Level::note, "points",
                    fmt::format("of {} points at most {} are taken", points.size(), kMostPoints));
}

void examine_sight(Examination& examination) {
  if (!examination.config.model.start_from.empty()) return;  // other Gaussians than the points
  std::vector<Vec3f> points;
  for (const ColmapPoint& point : examination.model().points)
    points.push_back(Vec3f(point.position));
  const RenderConfig& render = examination.config.render;
  const DepthLimits limits{render.near_plane, render.far_plane};
  const SceneSight sight =
      scene_sight(training_cameras(examination), {points.data(), points.size()}, limits);
  if (sight.is_blind())
    examination.add(Level::fatal, "sight", text_of(sight, limits));
  else if (sight.is_doubtful())
    examination.add(Level::warning, "sight", text_of(sight, limits));
}

}  // namespace gs
