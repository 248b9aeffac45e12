// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/refine/refine_lens.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "data_loaders/lenses/lens.h"
#include "data_loaders/lenses/lens_formulas.h"
#include "gs_core/error.h"

namespace gs {
namespace {

constexpr int kGridColumns = 41, kGridRows = 31;  // lenses are smooth

/// A pixel and the ray that lands there.
struct Sight {
  Vec2d pixel, ray;
};

template <class T>
Vec2<T> landed(CameraModel model, const T* params, const Vec2d& ray) {
  FocalPlane<T> plane;
  LensCoefficients<T> lens;
  unpack(model, params, plane, lens);
  const Vec2<T> u = distorted(lens, Vec2<T>(T(ray.x), T(ray.y)));
  return {plane.fx * u.x + plane.cx, plane.fy * u.y + plane.cy};
}

struct Landing {
  CameraModel model;
  Sight sight;

  template <class T>
  bool operator()(const T* params, T* residual) const {
    const Vec2<T> at = landed(model, params, sight.ray);
    residual[0] = at.x - sight.pixel.x;
    residual[1] = at.y - sight.pixel.y;
    return true;
  }
};

ceres::CostFunction* cost_of(CameraModel model, const Sight& sight) {
  auto* landing = new Landing{model, sight};
  if (model == CameraModel::pinhole) return new ceres::AutoDiffCostFunction<Landing, 2, 4>(landing);
  GS_CHECK(model == CameraModel::opencv);
  return new ceres::AutoDiffCostFunction<Landing, 2, 8>(landing);
}

/// From the center of the first pixel to that of the last.
std::vector<Sight> sights_of(const LensCamera& lens) {
  const PinholeCamera<double>& plane = lens.pinhole;
  std::vector<Sight> sights;
  for (int j = 0; j < kGridRows; ++j)
    for (int i = 0; i < kGridColumns; ++i) {
      const Vec2d pixel(0.5 + (plane.width - 1) * double(i) / (kGridColumns - 1),
                        0.5 + (plane.height - 1) * double(j) / (kGridRows - 1));
      const auto ray = undistorted(
          lens, Vec2d((pixel.x - plane.cx) / plane.fx, (pixel.y - plane.cy) / plane.fy));
      if (ray) sights.push_back({pixel, *ray});
    }
  return sights;
}

}  // namespace

FittedCamera fit_camera(const ColmapCamera& camera, CameraModel target, const std::string& photo) {
  const LensCamera lens = lens_camera(camera, photo);
  const std::vector<Sight> sights = sights_of(lens);
  FittedCamera fit;
  fit.camera = {camera.id, target, camera.width, camera.height, {}};
  std::vector<double>& params = fit.camera.params;
  const PinholeCamera<double>& plane = lens.pinhole;
  params = {plane.fx, plane.fy, plane.cx, plane.cy};
  params.resize(std::size_t(camera_model_info(target).param_count), 0.0);
  fit.unseen_share = 1 - double(sights.size()) / (kGridColumns * kGridRows);

  ceres::Problem problem;
  for (const Sight& sight : sights)
    problem.AddResidualBlock(cost_of(target, sight), nullptr, params.data());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-12;
  options.num_threads = 1;  // sums in one order
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  const bool is_camera = params[0] > 0 && params[1] > 0;
  const LensCamera fitted = is_camera ? lens_camera(fit.camera, photo) : lens;
  for (const Sight& sight : sights) {
    const Vec2d off = landed<double>(target, params.data(), sight.ray) - sight.pixel;
    const double error = is_camera && is_unfolded(fitted, sight.ray)
                             ? std::sqrt(inner(off, off))
                             : std::numeric_limits<double>::infinity();
    fit.mean_error += error / double(sights.size());
    fit.max_error = std::max(fit.max_error, error);
  }
  return fit;
}

}  // namespace gs
