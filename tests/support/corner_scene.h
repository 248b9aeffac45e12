// SPDX-License-Identifier: Apache-2.0
// A corner of a room, whose depths and normals are known: a floor and two walls, seen from cameras
// near the origin. Its colors change so slowly that photos hardly tell how far away they are.
#pragma once

#include "gs_core/math/render/normal_map.h"
#include "tests/support/scene_run.h"

namespace gs {

struct Corner {
  static constexpr float kFloor = 1, kBack = 5, kSide = 2;  // world units

  float depth = 1e9f;     // of what a ray of depth 1 meets first
  Vec3f normal{0, 0, 0};  // its normal, in world axes

  Corner(const Vec3f& origin, const Vec3f& ray) {
    const auto meet = [&](float distance, float along, const Vec3f& axis) {
      if (!(along > 0) || distance / along >= depth) return;
      depth = distance / along;
      normal = -axis;
    };
    meet(kFloor - origin.y, ray.y, {0, 1, 0});
    meet(kBack - origin.z, ray.z, {0, 0, 1});
    meet(kSide - origin.x, ray.x, {1, 0, 0});
  }
  static Vec3f color(const Vec3f& p) {
    return {0.5f + 0.1f * p.x, 0.5f + 0.15f * p.y, 0.75f - 0.1f * p.z};
  }
};

/// A view with its photo, exact depth and exact normals.
inline View view_of_corner(const Camera& camera) {
  View view;
  view.camera = camera;
  view.photo = view.normals = Image8(camera.width, camera.height, 3);
  view.depth = ImageF(camera.width, camera.height, 1);
  view.has_depth_map = view.has_normal_map = true;
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const Vec3f p{(float(x) + 0.5f - camera.cx) / camera.fx,
                    (float(y) + 0.5f - camera.cy) / camera.fy, 1};
      const Vec3f ray = multiply_transposed(camera.cam_from_world_rotation, p);
      const Corner corner(camera.position(), ray);
      view.depth.at(x, y, 0) = corner.depth;
      const NormalBytes n =
          bytes_of_normal(multiply(camera.cam_from_world_rotation, corner.normal));
      view.normals.at(x, y, 0) = n.x, view.normals.at(x, y, 1) = n.y,
                            view.normals.at(x, y, 2) = n.z;
      const Vec3f color = Corner::color(camera.position() + corner.depth * ray);
      for (int c = 0; c < 3; ++c)
        view.photo.at(x, y, c) = std::uint8_t(std::lround(255 * std::clamp(color[c], 0.0f, 1.0f)));
    }
  return view;
}

inline Camera corner_camera(float turn, float shift) {
  Camera camera = orbit_camera(turn);
  camera.cam_from_world_translation = {shift, 0.1f * shift, 0.3f};
  return camera;
}

/// Four views to train on, and two that are held out, each after finish(view, draws). The points are
/// off by a tenth of their depth.
template <class F>
Scene corner_scene(std::uint64_t seed, F&& finish) {
  Scene scene;
  scene.source = "a scene of the test";
  Draws draws(seed);
  for (std::size_t k = 0; k < 4; ++k) {
    View view = view_of_corner(corner_camera(0.15f * float(k) - 0.2f, 0.2f * float(k) - 0.3f));
    view.name = "view " + std::to_string(k);
    for (std::size_t i = 0; i < view.depth.pixels.size(); i += 29) {
      const float u = float(i % 48) + 0.5f, v = float(i / 48) + 0.5f;
      const float depth = view.depth.pixels[i] * (1 + 0.1f * draws.normal());
      scene.points.push_back({behind_pixel(view.camera, u, v, depth), {128, 128, 128}});
    }
    finish(view, draws);
    scene.train_views.push_back(std::move(view));
  }
  for (const float at : {-0.1f, 0.1f}) {
    View view = view_of_corner(corner_camera(0.7f * at, at));
    view.name = "held out " + std::to_string(scene.test_views.size());
    finish(view, draws);
    scene.test_views.push_back(std::move(view));
  }
  scene.extent = camera_extent(scene.train_views);
  return scene;
}

/// A run on it, in which no Gaussian is added.
inline Config corner_run(std::uint64_t seed) {
  Config config = short_run();
  config.train.iterations = 300;
  config.train.seed = seed;
  config.optimizer.moments = MomentStorage::floats;  // beyond 45 dB half moments are too coarse
  config.model.sh_degree = 0;
  config.optimizer.position_lr_initial = 3e-3f;
  config.density.until_step = 0;
  config.density.reset_opacity_until = 0;
  config.density.camera_clearance = 0;
  return config;
}

}  // namespace gs
