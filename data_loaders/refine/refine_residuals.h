// SPDX-License-Identifier: Apache-2.0
// The residuals of refine_cameras.cpp: the distance between the pixel where a point lands and the one
// where it was seen, and the change of each lens. refine_problem.cpp measures the same distance.
#pragma once

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>
#include <ceres/rotation.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "data_loaders/lenses/lens_formulas.h"
#include "data_loaders/refine/rigid_motion.h"

namespace gs::refinement {

using rigid::Motion;

inline constexpr double kFocalSpread = 0.1;    // of the prior, of the focal length
inline constexpr double kCenterSpread = 0.01;  // of the longer side
inline constexpr double kCoefficientSpread = 0.1;
inline constexpr double kNearest = 1e-6;  // depth; nearer points get a huge error

/// The pixel where a point in camera space projects to. A fisheye also sees points beside and
/// behind it.
template <class T>
Vec2<T> landed(CameraModel model, const T* params, const Vec3<T>& at) {
  using std::atan2, std::sqrt;
  FocalPlane<T> plane;
  LensCoefficients<T> lens;
  unpack(model, params, plane, lens);
  const bool is_fisheye = lens.lens == Lens::fisheye || lens.lens == Lens::fisheye_rad_tan;
  const T r2 = at.x * at.x + at.y * at.y;
  Vec2<T> u;
  if (is_fisheye && r2 > kNearest * kNearest * at.z * at.z) {
    const T r = sqrt(r2);
    const T scale = atan2(r, at.z) / r;
    u = lens_formulas::polynomial(lens, Vec2<T>(at.x * scale, at.y * scale));
  } else {
    const T z = at.z > kNearest ? at.z : T(kNearest);
    const Vec2<T> ideal(at.x / z, at.y / z);
    const bool is_pinhole_yet = lens.lens == Lens::fov && lens.k[0] == T(0);
    u = is_pinhole_yet ? ideal : distorted(lens, ideal);
  }
  return {plane.fx * u.x + plane.cx, plane.fy * u.y + plane.cy};
}

/// One observation: pixel of the projected point - pixel seen.
struct Reprojection {
  CameraModel model;
  Motion cam_from_frame;
  Vec2d seen;

  template <class T>
  bool operator()(const T* rotation, const T* translation, const T* params, const T* point,
                  T* residual) const {
    T in_frame[3], in_camera[3];
    ceres::UnitQuaternionRotatePoint(rotation, point, in_frame);
    for (int i = 0; i < 3; ++i) in_frame[i] += translation[i];
    const Quat<double>& q = cam_from_frame.rotation;
    const T sensor[4] = {T(q.w), T(q.x), T(q.y), T(q.z)};
    ceres::UnitQuaternionRotatePoint(sensor, in_frame, in_camera);
    const Vec3d& t = cam_from_frame.translation;
    const Vec2<T> pixel =
        landed(model, params, Vec3<T>(in_camera[0] + t.x, in_camera[1] + t.y, in_camera[2] + t.z));
    residual[0] = pixel.x - seen.x;
    residual[1] = pixel.y - seen.y;
    return true;
  }
};

inline ceres::CostFunction* cost_of(const Reprojection& residual) {
  const auto make = [&]<int kParams>() -> ceres::CostFunction* {
    return new ceres::AutoDiffCostFunction<Reprojection, 2, 4, 3, kParams, 3>(
        new Reprojection(residual));
  };
  switch (camera_model_info(residual.model).param_count) {
    case 2: return make.operator()<2>();
    case 3: return make.operator()<3>();
    case 4: return make.operator()<4>();
    case 5: return make.operator()<5>();
    case 6: return make.operator()<6>();
    case 8: return make.operator()<8>();
    case 12: return make.operator()<12>();
    default: return make.operator()<16>();
  }
}

/// (value - what it was) / spread, of every parameter of a camera.
inline ceres::CostFunction* prior_of(const ColmapCamera& camera) {
  // What the parameters are, by where unpack() puts them.
  std::vector<double> index(camera.params.size());
  for (std::size_t i = 0; i < index.size(); ++i) index[i] = double(i + 1);
  FocalPlane<double> plane;
  LensCoefficients<double> lens;
  unpack<double>(camera.model, index.data(), plane, lens);
  ceres::Vector mean(index.size());
  ceres::Matrix weights = ceres::Matrix::Zero(mean.size(), mean.size());
  for (std::size_t i = 0; i < index.size(); ++i) {
    const bool is_focal = index[i] == plane.fx || index[i] == plane.fy;
    const bool is_center = index[i] == plane.cx || index[i] == plane.cy;
    const double spread = is_focal    ? kFocalSpread * camera.params[i]
                          : is_center ? kCenterSpread * std::max(camera.width, camera.height)
                                      : kCoefficientSpread;
    const auto row = Eigen::Index(i);
    mean[row] = camera.params[i];
    weights(row, row) = 1 / spread;
  }
  return new ceres::NormalPrior(weights, mean);
}

}  // namespace gs::refinement
