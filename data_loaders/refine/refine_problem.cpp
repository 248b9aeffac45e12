// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/refine/refine_problem.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "data_loaders/lenses/lens.h"
#include "data_loaders/lenses/lens_formulas.h"
#include "data_loaders/refine/refine_residuals.h"

namespace gs::refinement {
namespace {

using namespace rigid;

constexpr std::size_t kFewestInFrame = 10;  // observations: six unknowns, and some are wrong

Lens lens_of(const ColmapCamera& camera) {
  FocalPlane<double> plane;
  LensCoefficients<double> lens;
  unpack<double>(camera.model, camera.params.data(), plane, lens);
  return lens.lens;
}

}  // namespace

Motion pose_of(const ColmapImage& image) {
  return {image.cam_from_world_rotation, image.cam_from_world_translation};
}

BundleProblem::BundleProblem(ColmapModel& model) : model(model) {
  for (const auto& [id, camera] : model.cameras) {
    const auto user =
        std::find_if(model.images.begin(), model.images.end(),
                     [id = id](const ColmapImage& image) { return image.camera_id == id; });
    if (user != model.images.end()) lens_camera(camera, user->name);  // throws for unknown lenses
  }
  make_frames();
  collect(seen_points(model, "--refine-cameras"));
}

void BundleProblem::make_frames() {
  std::unordered_map<std::uint64_t, std::size_t> frame_of_image;  // index in model.frames
  for (std::size_t i = 0; i < model.frames.size(); ++i)
    for (const std::uint64_t image : model.frames[i].image_ids) frame_of_image[image] = i;
  std::unordered_map<std::size_t, std::size_t> place;  // in frames
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    const auto found = frame_of_image.find(model.images[i].id);
    const bool is_new =
        found == frame_of_image.end() || place.try_emplace(found->second, frames.size()).second;
    if (is_new) frames.push_back({{}, pose_of(model.images[i]), true});
    const std::size_t frame = is_new ? frames.size() - 1 : place.at(found->second);
    frames[frame].images.push_back(i);
    frame_of.push_back(frame);
    cam_from_frame.push_back(product(pose_of(model.images[i]), inverse(frames[frame].pose)));
  }
  for (const Frame& frame : frames)
    for (const std::size_t image : frame.images)
      has_known_size = has_known_size || length(cam_from_frame[image].translation) > 0;
}

void BundleProblem::collect(const std::vector<std::vector<SeenPoint>>& seen) {
  std::vector<Observation> all;
  for (std::size_t image = 0; image < seen.size(); ++image)
    for (const SeenPoint& point : seen[image])
      if (is_in_front(image, point)) all.push_back({image, point});
  keep_refinable(all);
  std::vector<std::size_t> in_frame(frames.size(), 0);
  for (const Observation& observation : all) ++in_frame[frame_of[observation.image]];
  for (std::size_t i = 0; i < frames.size(); ++i)
    frames[i].is_refined = in_frame[i] >= kFewestInFrame;
  std::erase_if(all, [&](const Observation& o) { return !frame_with(o.image).is_refined; });
  keep_refinable(all);
  observations = std::move(all);
}

void BundleProblem::keep_refinable(std::vector<Observation>& all) {
  std::vector<int> photos(model.points.size(), 0);
  for (const Observation& observation : all) ++photos[observation.seen.point];
  point_is_refined.resize(photos.size());
  for (std::size_t i = 0; i < photos.size(); ++i) point_is_refined[i] = photos[i] >= 2;
  std::erase_if(all, [&](const Observation& o) { return !point_is_refined[o.seen.point]; });
}

bool BundleProblem::is_in_front(std::size_t image, const SeenPoint& seen) const {
  const Vec2d error = error_of({image, seen});
  const Motion pose = pose_of(model.images[image]);
  const Vec3d at = rotated(pose.rotation, model.points[seen.point].position) + pose.translation;
  const Lens lens = lens_of(model.cameras.at(model.images[image].camera_id));
  const bool sees_behind = lens == Lens::fisheye || lens == Lens::fisheye_rad_tan;
  return (sees_behind || at.z > kNearest) && std::isfinite(error.x + error.y);
}

/// By the image's pose, pixels.
Vec2d BundleProblem::error_of(const Observation& observation) const {
  const ColmapImage& image = model.images[observation.image];
  const ColmapCamera& camera = model.cameras.at(image.camera_id);
  const Vec3d at =
      rotated(image.cam_from_world_rotation, model.points[observation.seen.point].position) +
      image.cam_from_world_translation;
  return landed<double>(camera.model, camera.params.data(), at) - observation.seen.pixel;
}

std::pair<double, double> BundleProblem::errors() const {
  if (observations.empty()) return {0, 0};
  std::vector<double> lengths;
  double sum = 0;
  for (const Observation& observation : observations) {
    const Vec2d error = error_of(observation);
    lengths.push_back(std::sqrt(inner(error, error)));
    sum += lengths.back();
  }
  const auto middle = lengths.begin() + std::ptrdiff_t(lengths.size() / 2);
  std::nth_element(lengths.begin(), middle, lengths.end());
  return {sum / double(lengths.size()), *middle};
}

std::size_t BundleProblem::image_count() const {
  std::size_t count = 0;
  for (const Frame& frame : frames) count += frame.is_refined ? frame.images.size() : 0;
  return count;
}

std::size_t BundleProblem::point_count() const {
  return std::size_t(std::count(point_is_refined.begin(), point_is_refined.end(), true));
}

}  // namespace gs::refinement
