// SPDX-License-Identifier: Apache-2.0
// Cameras of every COLMAP model that gemsplat undistorts, and where points land in their photos.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "data_loaders/lenses/lens.h"

namespace gs {

struct LensCase {
  std::string label;
  ColmapCamera camera;
};

/// Typical and strong lenses of every model that has one, 320 x 240 pixels, with off-center
/// principal points.
inline std::vector<LensCase> lens_cases() {
  using enum CameraModel;
  struct Row {
    CameraModel model;
    std::vector<double> params;
  };
  const Row rows[] = {
      {simple_radial, {260, 163, 117, -0.09}},
      {simple_radial, {260, 163, 117, 0.15}},
      {radial, {260, 163, 117, -0.12, 0.03}},
      {radial, {260, 163, 117, 0.1, 0.02}},
      {opencv, {262, 258, 151, 127, -0.11, 0.02, 2e-3, -3e-3}},
      {opencv, {262, 258, 151, 127, 0.05, -0.02, -4e-3, 1e-3}},
      {full_opencv, {262, 258, 151, 127, 0.2, 0.05, 1e-3, -2e-3, 0.01, 0.3, 0.06, 0.005}},
      {full_opencv, {262, 258, 151, 127, -0.2, 0.05, 1e-3, 2e-3, -0.01, -0.1, 0.02, 0.001}},
      {opencv_fisheye, {180, 178, 158, 122, -0.02, 0.005, -0.002, 0.001}},
      {opencv_fisheye, {180, 178, 158, 122, 0.08, -0.03, 0.01, -0.002}},
      {simple_radial_fisheye, {180, 158, 122, 0.03}},
      {simple_radial_fisheye, {180, 158, 122, -0.05}},
      {radial_fisheye, {180, 158, 122, 0.03, -0.01}},
      {radial_fisheye, {180, 158, 122, -0.04, 0.02}},
      {simple_fisheye, {180, 158, 122}},
      {simple_fisheye, {165, 158, 122}},
      {fisheye, {180, 181, 158, 122}},
      {fisheye, {170, 164, 158, 122}},
      {thin_prism_fisheye,
       {180, 181, 158, 122, -0.03, 0.01, 1e-3, -2e-3, 0.002, -0.001, 3e-3, -2e-3}},
      {thin_prism_fisheye,
       {165, 166, 158, 122, 0.05, -0.02, -2e-3, 3e-3, 0.005, -0.002, -4e-3, 5e-3}},
      {rad_tan_thin_prism_fisheye,  // like the lenses of Project Aria
       {180, 181, 158, 122, 0.4, -0.5, 0.2, 0.05, -0.06, 0.01, 1e-3, -5e-4, 8e-4, -2e-4, -9e-4,
        3e-4}},
      {rad_tan_thin_prism_fisheye,
       {180, 181, 158, 122, -0.03, 0.01, -0.005, 0.002, -0.001, 2e-4, -3e-3, 4e-3, -5e-3, 2e-3,
        4e-3, -1e-3}},
      {CameraModel::fov, {230, 228, 158, 122, 0.93}},
      {CameraModel::fov, {230, 228, 158, 122, 0.3}},
      {CameraModel::fov, {230, 228, 158, 122, 1e-3}},
      {simple_division, {230, 163, 117, -0.2}},
      {simple_division, {260, 163, 117, 0.1}},
      {division, {230, 233, 158, 122, -0.25}},
      {division, {260, 255, 158, 122, 0.12}},
      {eucm, {180, 178, 158, 122, 0.6, 1.1}},
      {eucm, {230, 228, 158, 122, 0.4, 0.8}},
      {eucm, {260, 258, 158, 122, -0.1, 1.2}},
  };
  std::vector<LensCase> cases;
  for (const Row& row : rows)
    cases.push_back(
        {std::string(camera_model_info(row.model).name) + " #" + std::to_string(&row - rows),
         {1, row.model, 320, 240, row.params}});
  return cases;
}

/// The r' with r' / (1 + k r'^2) = r that is nearest to 0, by bisection.
inline double division_radius(double k, double r) {
  double low = 0, high = k > 0 ? 1 / std::sqrt(k) : r;
  for (int step = 0; step < 200; ++step) {
    const double middle = (low + high) / 2;
    (middle / (1 + k * middle * middle) < r ? low : high) = middle;
  }
  return low;
}

/// Where a point in camera space projects to in the photo, in pixels with centers at + 0.5. This is
/// written from COLMAP's description of its parameters, in spherical coordinates for fisheyes, and
/// shares no code with lens.cpp.
inline Vec2d projected(const ColmapCamera& camera, double X, double Y, double Z) {
  const std::vector<double>& p = camera.params;
  const double x = X / Z, y = Y / Z, r2 = x * x + y * y, r4 = r2 * r2, r6 = r4 * r2;
  const double theta = std::atan2(std::hypot(X, Y), Z), turn = std::atan2(Y, X);
  const double x_turn = std::cos(turn), y_turn = std::sin(turn);
  const auto fisheye = [&](double fx, double fy, double cx, double cy, double k1, double k2,
                           double k3, double k4) {
    const double bent = theta + k1 * std::pow(theta, 3) + k2 * std::pow(theta, 5) +
                        k3 * std::pow(theta, 7) + k4 * std::pow(theta, 9);
    return Vec2d(fx * bent * x_turn + cx, fy * bent * y_turn + cy);
  };
  const auto tangential = [&](double a, double b, double p1, double p2) {
    return Vec2d(2 * p1 * a * b + p2 * (3 * a * a + b * b),
                 2 * p2 * a * b + p1 * (a * a + 3 * b * b));
  };
  switch (camera.model) {
    case CameraModel::simple_radial: {
      const double s = 1 + p[3] * r2;
      return {p[0] * x * s + p[1], p[0] * y * s + p[2]};
    }
    case CameraModel::radial: {
      const double s = 1 + p[3] * r2 + p[4] * r4;
      return {p[0] * x * s + p[1], p[0] * y * s + p[2]};
    }
    case CameraModel::opencv: {
      const double s = 1 + p[4] * r2 + p[5] * r4;
      const Vec2d t = tangential(x, y, p[6], p[7]);
      return {p[0] * (x * s + t.x) + p[2], p[1] * (y * s + t.y) + p[3]};
    }
    case CameraModel::full_opencv: {
      const double s =
          (1 + p[4] * r2 + p[5] * r4 + p[8] * r6) / (1 + p[9] * r2 + p[10] * r4 + p[11] * r6);
      const Vec2d t = tangential(x, y, p[6], p[7]);
      return {p[0] * (x * s + t.x) + p[2], p[1] * (y * s + t.y) + p[3]};
    }
    case CameraModel::opencv_fisheye:
      return fisheye(p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]);
    case CameraModel::simple_radial_fisheye: return fisheye(p[0], p[0], p[1], p[2], p[3], 0, 0, 0);
    case CameraModel::radial_fisheye: return fisheye(p[0], p[0], p[1], p[2], p[3], p[4], 0, 0);
    case CameraModel::simple_fisheye: return fisheye(p[0], p[0], p[1], p[2], 0, 0, 0, 0);
    case CameraModel::fisheye: return fisheye(p[0], p[1], p[2], p[3], 0, 0, 0, 0);
    case CameraModel::thin_prism_fisheye: {
      const Vec2d bent = fisheye(1, 1, 0, 0, p[4], p[5], p[8], p[9]);
      const Vec2d t = tangential(theta * x_turn, theta * y_turn, p[6], p[7]);
      return {p[0] * (bent.x + t.x + p[10] * theta * theta) + p[2],
              p[1] * (bent.y + t.y + p[11] * theta * theta) + p[3]};
    }
    case CameraModel::rad_tan_thin_prism_fisheye: {
      double bent = theta;
      for (int i = 0; i < 6; ++i) bent += p[4 + i] * std::pow(theta, 3 + 2 * i);
      const double a = bent * x_turn, b = bent * y_turn, b2 = bent * bent;
      return {
          p[0] * (a + p[10] * (b2 + 2 * a * a) + 2 * p[11] * a * b + p[12] * b2 + p[13] * b2 * b2) +
              p[2],
          p[1] * (b + p[11] * (b2 + 2 * b * b) + 2 * p[10] * a * b + p[14] * b2 + p[15] * b2 * b2) +
              p[3]};
    }
    case CameraModel::fov: {
      const double bent = std::atan(2 * std::tan(p[4] / 2) * std::tan(theta)) / p[4];
      return {p[0] * bent * x_turn + p[2], p[1] * bent * y_turn + p[3]};
    }
    case CameraModel::simple_division: {
      const double bent = division_radius(p[3], std::sqrt(r2));
      return {p[0] * bent * x_turn + p[1], p[0] * bent * y_turn + p[2]};
    }
    case CameraModel::division: {
      const double bent = division_radius(p[4], std::sqrt(r2));
      return {p[0] * bent * x_turn + p[2], p[1] * bent * y_turn + p[3]};
    }
    case CameraModel::eucm: {
      const double depth = p[4] * std::sqrt(p[5] * (X * X + Y * Y) + Z * Z) + (1 - p[4]) * Z;
      return {p[0] * X / depth + p[2], p[1] * Y / depth + p[3]};
    }
    default: ADD_FAILURE(); return {};
  }
}

}  // namespace gs
