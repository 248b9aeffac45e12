// SPDX-License-Identifier: Apache-2.0
#include "gs_app/blocks/picture_shares.h"

#include <algorithm>
#include <cmath>

namespace gs {
namespace {

constexpr int kWidth = 160;  // pixels of a picture at most; shares need no detail

Camera small_camera(Camera camera) {
  if (camera.width <= kWidth) return camera;
  const int height = std::max(1, int(std::lround(double(camera.height) * kWidth / camera.width)));
  const float x = float(kWidth) / float(camera.width), y = float(height) / float(camera.height);
  camera.width = kWidth;
  camera.height = height;
  camera.fx *= x;
  camera.cx *= x;
  camera.fy *= y;
  camera.cy *= y;
  return camera;
}

std::vector<Camera> small_cameras(const SceneOutline& scene) {
  std::vector<Camera> cameras;
  for (const Camera& camera : scene.cameras) cameras.push_back(small_camera(camera));
  return cameras;
}

std::vector<Vec3d> places_of(const GaussianModel& model) {
  std::vector<Vec3d> places;
  places.reserve(model.gaussians.count());
  for (const Vec3f& mean : model.gaussians.mean) places.push_back(Vec3d(mean) + model.world_offset);
  return places;
}

// The model in the coordinates of the scene's cameras.
GaussianModel in_scene(GaussianModel model, const Vec3d& world_offset) {
  const Vec3d shift = model.world_offset - world_offset;
  if (shift != Vec3d(0.0))
    for (Vec3f& mean : model.gaussians.mean) mean = Vec3f(Vec3d(mean) + shift);
  model.world_offset = world_offset;
  return model;
}

}  // namespace

PictureShares::PictureShares(OpenedModel opened, const Config& config, const SceneOutline& scene,
                             Backend& backend)
    : places_(places_of(opened.model)), cameras_(small_cameras(scene)),
      gaussians_(copy_to(backend.memory(), in_scene(std::move(opened.model), scene.world_offset))),
      meter_(backend.renderer(), gaussians_.span(), view_settings(opened, config)) {}

void PictureShares::find_inside(const std::vector<Block>& blocks) {
  if (!is_inside_.empty()) return;
  for (const Block& block : blocks) {
    is_inside_.emplace_back();
    for (const Vec3d& place : places_) is_inside_.back().push_back(block.holds(place));
  }
}

void PictureShares::start_from_model(std::vector<Block>& blocks) {
  find_inside(blocks);
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    blocks[b].start = places_.size();
    blocks[b].start_outside = std::size_t(std::ranges::count(is_inside_[b], false));
  }
}

std::vector<double> PictureShares::operator()(std::size_t view, const std::vector<Block>& blocks) {
  find_inside(blocks);
  const std::vector<float>& contributions = meter_.measure(cameras_[view]);
  std::vector<double> shares(blocks.size(), 0);
  double all = 0;
  for (std::size_t i = 0; i < contributions.size(); ++i) {
    all += double(contributions[i]);
    for (std::size_t b = 0; b < shares.size(); ++b)
      if (contributions[i] > 0 && is_inside_[b][i]) shares[b] += double(contributions[i]);
  }
  for (double& share : shares) share = all > 0 ? share / all : 0;
  return shares;
}

}  // namespace gs
