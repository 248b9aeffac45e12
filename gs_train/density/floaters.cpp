// SPDX-License-Identifier: Apache-2.0
#include "gs_train/density/floaters.h"

#include <algorithm>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/geometry/seen_pixel.h"
#include "gs_core/log.h"
#include "gs_core/threads/parallel.h"
#include "gs_train/density/contribution.h"

namespace gs {
namespace {

constexpr std::size_t kFewestPoints = 100;  // in a picture; from fewer, no distance is estimated
constexpr std::size_t kWrongPoints = 100;   // the nearest 1 / 100 of the points may be wrong
constexpr float kSeenShare = 1;      // pixels; a view with at least this contribution is a witness
constexpr float kHiddenLogit = -30;  // logit of an opacity of 1e-13

float squared_distance(const Vec3f& a, const Vec3f& b) {
  const Vec3f d = a - b;
  return inner(d, d);
}

float nearest_points(const Camera& camera, const std::vector<ScenePoint>& points) {
  const Vec3f center = camera.position();
  std::vector<float> distances;
  for (const ScenePoint& point : points)
    if (seen_pixel(camera, point.position))
      distances.push_back(squared_distance(point.position, center));
  if (distances.size() < kFewestPoints) return 0;
  const auto nearest = distances.begin() + std::ptrdiff_t(distances.size() / kWrongPoints);
  std::nth_element(distances.begin(), nearest, distances.end());
  return std::sqrt(*nearest);
}

}  // namespace

std::vector<float> clear_distances(const std::vector<View>& views,
                                   const std::vector<ScenePoint>& points, float clearance) {
  std::vector<float> distances(views.size());
  parallel_for(views.size(), 1, [&](std::size_t v) {
    distances[v] = clearance * nearest_points(views[v].camera, points);
  });
  return distances;
}

ClearSpace::ClearSpace(const Scene& scene, float clearance) {
  if (!(clearance > 0)) {
    of_views_.resize(scene.train_views.size(), {Vec3f(0), 0});
    return;
  }
  const std::vector<float> radii = clear_distances(scene.train_views, scene.points, clearance);
  for (std::size_t v = 0; v < radii.size(); ++v) {
    of_views_.push_back({scene.train_views[v].camera.position(), radii[v] * radii[v]});
    if (radii[v] > 0) known_.push_back(of_views_.back());
  }
}

bool ClearSpace::holds(std::size_t v, const Vec3f& point) const {
  return squared_distance(point, of_views_[v].center) < of_views_[v].squared_radius;
}

std::vector<std::uint8_t> ClearSpace::marks(const std::vector<Vec3f>& points) const {
  if (known_.empty()) return {};
  std::vector<std::uint8_t> marks(points.size());
  parallel_for(points.size(), 4096, [&](std::size_t i) {
    marks[i] = std::any_of(known_.begin(), known_.end(), [&](const Sphere& sphere) {
      return squared_distance(points[i], sphere.center) < sphere.squared_radius;
    });
  });
  if (std::find(marks.begin(), marks.end(), 1) == marks.end()) marks.clear();
  return marks;
}

std::vector<std::uint8_t> find_floaters(Renderer& renderer, const GaussiansSpan& gaussians,
                                        const std::vector<Vec3f>& means, const Scene& scene,
                                        const RenderSettings& settings, float clearance,
                                        int witnesses) {
  const ClearSpace space(scene, clearance);
  std::vector<std::uint8_t> is_floater = space.marks(means);
  if (witnesses == 0 || is_floater.empty()) return is_floater;
  std::vector<int> seen_by(means.size());
  ContributionMeter meter(renderer, gaussians, settings);
  for (std::size_t v = 0; v < scene.train_views.size(); ++v) {
    const std::vector<float>& shares = meter.measure(scene.train_views[v].camera);
    parallel_for(means.size(), 4096, [&](std::size_t i) {
      if (is_floater[i] && shares[i] >= kSeenShare && !space.holds(v, means[i])) ++seen_by[i];
    });
  }
  for (std::size_t i = 0; i < means.size(); ++i)
    is_floater[i] = is_floater[i] && seen_by[i] < witnesses;
  return is_floater;
}

HiddenFloaters::HiddenFloaters(TrainingModel& model, const ClearSpace& space) : model_(model) {
  const std::vector<std::uint8_t> is_floater = space.marks(model.gaussians.mean.download());
  if (is_floater.empty()) return;
  opacities_ = model.gaussians.logit_opacity.download();
  std::vector<float> hidden = opacities_;
  for (std::size_t i = 0; i < hidden.size(); ++i)
    if (is_floater[i]) hidden[i] = kHiddenLogit;
  set(hidden);
}

HiddenFloaters::~HiddenFloaters() {
  try {
    if (!opacities_.empty()) set(opacities_);
  } catch (const Error& error) {  // the device is broken; the next call to it throws
    log_warning("{}", error.what());
  }
}

void HiddenFloaters::set(const std::vector<float>& opacities) {
  const Buffer<float>& all = model_.gaussians.logit_opacity;
  all.memory().upload(all.data(), opacities.data(), opacities.size() * sizeof(float));
}

}  // namespace gs
