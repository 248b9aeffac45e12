// SPDX-License-Identifier: Apache-2.0
#include "gs_train/initialize/sky.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "gs_core/error.h"
#include "gs_core/geometry/seen_pixel.h"
#include "gs_core/log.h"
#include "gs_core/threads/parallel.h"
#include "gs_train/initialize/camera_center.h"

namespace gs {
namespace {

constexpr std::size_t kDirections = 20000;  // 1.4 degrees apart
constexpr float kExtents = 30;              // the sphere's least radius
constexpr float kBeyondPoints = 2;          // its least radius, in distances of the farthest point
constexpr int kCells = 32;                  // of the grid over a photo, along its longer side
constexpr std::size_t kMostViews = 256, kMostPoints = 100000;  // to look at
constexpr std::size_t kLeastViews = 2;  // that must see a direction without points
constexpr int kAgreement = 30;          // most bytes between the quartiles of a channel

using Color = std::array<std::uint8_t, 3>;

// Every `step`-th of `count` things, so that at most `most` are left.
std::size_t step_for(std::size_t count, std::size_t most) { return (count + most - 1) / most; }

// A spiral from pole to pole, whose turns are as far apart as its points.
std::vector<Vec3f> even_directions() {
  constexpr double kGoldenAngle = std::numbers::pi * (3 - 2.2360679774997896);
  std::vector<Vec3f> directions(kDirections);
  for (std::size_t i = 0; i < kDirections; ++i) {
    const double z = 1 - (2 * double(i) + 1) / double(kDirections), r = std::sqrt(1 - z * z);
    const double angle = kGoldenAngle * double(i);
    directions[i] = {float(r * std::cos(angle)), float(r * std::sin(angle)), float(z)};
  }
  return directions;
}

// Which cells of a photo have a sparse point in them or in a cell beside them.
class PointCells {
 public:
  PointCells(const Camera& camera, const std::vector<ScenePoint>& points)
      : cell_(float(std::max(camera.width, camera.height)) / float(kCells)),
        columns_(cell_of(float(camera.width)) + 1), rows_(cell_of(float(camera.height)) + 1),
        taken_(std::size_t(columns_) * std::size_t(rows_), false) {
    const std::size_t step = step_for(points.size(), kMostPoints);
    for (std::size_t i = 0; i < points.size(); i += step) {
      if (const auto pixel = seen_pixel(camera, points[i].position))
        take_around(cell_of(pixel->x), cell_of(pixel->y));
    }
  }

  bool is_taken(int x, int y) const { return taken_[index(cell_of(float(x)), cell_of(float(y)))]; }

 private:
  int cell_of(float pixel) const { return int(pixel / cell_); }
  std::size_t index(int column, int row) const {
    return std::size_t(row) * std::size_t(columns_) + std::size_t(column);
  }
  void take_around(int column, int row) {
    for (int y = std::max(row - 1, 0); y <= std::min(row + 1, rows_ - 1); ++y)
      for (int x = std::max(column - 1, 0); x <= std::min(column + 1, columns_ - 1); ++x)
        taken_[index(x, y)] = true;
  }

  float cell_;  // side, in pixels
  int columns_, rows_;
  std::vector<bool> taken_;
};

// What the photos show in one direction.
struct Looks {
  std::size_t all = 0;       // photos that show it
  std::vector<Color> empty;  // its color in those that have no points there
};

// The color of the scene at a pixel: the photo's, without its exposure.
Color scene_color(const View& view, int x, int y) {
  Color color;
  for (int c = 0; c < 3; ++c) {
    const float value = float(view.photo.at(x, y, c)) / view.exposure[c];
    color[std::size_t(c)] = std::uint8_t(std::clamp(value, 0.0f, 255.0f) + 0.5f);
  }
  return color;
}

void look(const View& view, const std::vector<ScenePoint>& points,
          const std::vector<Vec3f>& on_sphere, std::vector<Looks>& looks) {
  const PointCells cells(view.camera, points);
  parallel_for(on_sphere.size(), 1024, [&](std::size_t i) {
    const auto pixel = seen_pixel(view.camera, on_sphere[i]);
    if (!pixel) return;
    const int x = int(pixel->x), y = int(pixel->y);
    if (!view.mask.empty() && view.mask.at(x, y, 0) < 128) return;
    ++looks[i].all;
    if (!cells.is_taken(x, y)) looks[i].empty.push_back(scene_color(view, x, y));
  });
}

// The median of each channel, if the photos agree on it and most of them have no points there.
bool sky_color(Looks& looks, Color& color) {
  const std::size_t count = looks.empty.size();
  if (count < kLeastViews || 2 * count < looks.all) return false;
  for (std::size_t c = 0; c < 3; ++c) {
    std::sort(looks.empty.begin(), looks.empty.end(),
              [c](const Color& a, const Color& b) { return a[c] < b[c]; });
    const std::size_t quartile = (count - 1) / 4;
    if (looks.empty[count - 1 - quartile][c] - looks.empty[quartile][c] > kAgreement) return false;
    color[c] = looks.empty[count / 2][c];
  }
  return true;
}

// Far enough that it is behind everything, and in front of the far plane.
float radius_around(const Vec3f& center, const Scene& scene, float far_plane) {
  float farthest2 = 0;
  for (const ScenePoint& point : scene.points) {
    const Vec3f offset = point.position - center;
    farthest2 = std::max(farthest2, inner(offset, offset));
  }
  return std::min(std::max(kExtents * scene.extent, kBeyondPoints * std::sqrt(farthest2)),
                  0.5f * far_plane);
}

std::vector<Looks> looks_at(const Scene& scene, const std::vector<Vec3f>& on_sphere) {
  const std::vector<View>& views = scene.train_views;
  const std::size_t step = step_for(views.size(), kMostViews);
  std::vector<Looks> looks(on_sphere.size());
  for (std::size_t i = 0; i < views.size(); i += step) {
    if (i + step < views.size()) prefetch_photo(views[i + step]);
    look(*with_photo(views[i]), scene.points, on_sphere, looks);
    release_photo(views[i]);
  }
  return looks;
}

}  // namespace

Sky sky_of(const Scene& scene, const Config& config) {
  Sky sky;
  if (config.model.sky == SkyModel::none) return sky;
  if (scene.points.empty()) {
    log_warning("model.sky is left out: without sparse points nothing tells the sky from the rest");
    return sky;
  }
  const Vec3f center = camera_center(scene.train_views);
  const float radius = radius_around(center, scene, config.render.far_plane);
  std::vector<Vec3f> on_sphere = even_directions();
  for (Vec3f& point : on_sphere) point = center + radius * point;
  std::vector<Looks> looks = looks_at(scene, on_sphere);
  for (std::size_t i = 0; i < on_sphere.size(); ++i)
    if (Color color; sky_color(looks[i], color)) sky.points.push_back({on_sphere[i], color});
  sky.spacing = radius * std::sqrt(4 * std::numbers::pi_v<float> / float(kDirections));
  log_info("sky: {} Gaussians at a distance of {:.4g}", sky.points.size(), radius);
  const std::int64_t cap = config.density.max_gaussians;
  if (cap > 0 && std::int64_t(2 * sky.points.size()) > cap)
    throw UsageError("model.sky needs " + std::to_string(sky.points.size()) +
                     " Gaussians, more than half of density.max_gaussians; raise it with "
                     "--max-gaussians, or set model.sky=none");
  return sky;
}

}  // namespace gs
