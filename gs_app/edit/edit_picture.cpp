// SPDX-License-Identifier: Apache-2.0
#include "gs_app/edit/edit_picture.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "gs_app/export/cameras.h"
#include "gs_app/pictures/comparison.h"
#include "gs_core/geometry/outliers.h"

namespace gs {
namespace {

constexpr int kWidth = 640, kHeight = 480;  // pixels of one picture
constexpr double kFieldOfView = 50;         // degrees, across the width
constexpr double kElevation = 35;           // degrees above the middle
constexpr double kMargin = 1.1;             // times the distance at which nine in ten means fit

Image8 picture_of(const EditModel& model, Camera camera, const EditTools& tools) {
  const double scale = std::min(1.0, double(kWidth) / camera.width);
  camera = resized(camera, std::max(1, int(std::lround(scale * camera.width))),
                   std::max(1, int(std::lround(scale * camera.height))));
  Backend& backend = tools.backend();
  const Gaussians gaussians = copy_to(backend.memory(), model.model);
  RenderPass pass(backend.memory());
  backend.renderer().forward(gaussians.span(), camera, settings_for(model, tools), pass);
  return backend.renderer().picture_of(pass);
}

}  // namespace

Camera camera_before(const GaussianModel& model) {
  std::vector<Vec3d> positions;
  for (const Vec3f& mean : model.gaussians.mean)
    if (is_finite(mean)) positions.push_back(Vec3d(mean));
  const Vec3d middle = median_position(positions);
  const double angle = kElevation * std::numbers::pi / 180;
  Camera camera;
  camera.width = kWidth;
  camera.height = kHeight;
  camera = with_field_of_view(camera, kFieldOfView);
  const double half_height = 0.5 * kHeight / double(camera.fy);
  const double distance = kMargin * std::max(ordinary_distance(middle, positions), 1e-6) /
                          std::sin(std::atan(half_height));
  const float c = float(std::cos(angle)), s = float(std::sin(angle));
  camera.cam_from_world_rotation = {{1, 0, 0}, {0, c, -s}, {0, s, c}};
  camera.cam_from_world_translation =
      Vec3f(0, 0, float(distance)) - multiply(camera.cam_from_world_rotation, Vec3f(middle));
  camera.time = 0.5f;
  return camera;
}

EditPicture::EditPicture(const EditModel& before, const EditTools& tools, std::string camera_name)
    : tools_(tools), camera_name_(std::move(camera_name)),
      camera_(camera_name_.empty() ? camera_before(before.model)
                                   : camera_named(before, camera_name_).camera),
      frame_(before.input_from_model), left_(picture_of(before, camera_, tools)) {}

Image8 EditPicture::beside(const EditModel& after) const {
  Camera camera = camera_;
  if (!camera_name_.empty())
    camera = camera_named(after, camera_name_).camera;
  else if (after.input_from_model != frame_)
    camera = camera_before(after.model);
  return side_by_side(left_, picture_of(after, camera, tools_));
}

}  // namespace gs
