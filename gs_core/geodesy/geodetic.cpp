// SPDX-License-Identifier: Apache-2.0
#include "gs_core/geodesy/geodetic.h"

#include <cmath>
#include <numbers>

namespace gs {
namespace {

constexpr double kRadians = std::numbers::pi / 180;
constexpr double kPolarAxis = kEarthAxis * (1 - kEarthFlattening);                  // b, meters
constexpr double kSquaredEccentricity = kEarthFlattening * (2 - kEarthFlattening);  // e^2
constexpr double kHighest = 1e6;                                                    // meters

/// N: the radius of curvature across the meridian.   meters
double transverse_radius(double sin_latitude) {
  return kEarthAxis / std::sqrt(1 - kSquaredEccentricity * sin_latitude * sin_latitude);
}

/// The latitude of a point at `radius` from the axis and `z` above the equator, in radians:
///
///   tan phi = (z + e'^2 b sin^3 beta) / (radius - e^2 a cos^3 beta),  tan beta = (1 - f) tan phi,
///   e'^2 = e^2 / (1 - e^2)
double latitude_of(double radius, double z) {
  constexpr double kSecondEccentricity = kSquaredEccentricity / (1 - kSquaredEccentricity);
  constexpr int kMostRounds = 10;  // near the ground the third changes nothing
  double beta = std::atan2(kEarthAxis * z, kPolarAxis * radius), latitude = beta;
  for (int round = 0; round < kMostRounds; ++round) {
    const double s = std::sin(beta), c = std::cos(beta), older = latitude;
    latitude = std::atan2(z + kSecondEccentricity * kPolarAxis * s * s * s,
                          radius - kSquaredEccentricity * kEarthAxis * c * c * c);
    beta = std::atan2((1 - kEarthFlattening) * std::sin(latitude), std::cos(latitude));
    if (latitude == older) break;
  }
  return latitude;
}

}  // namespace

bool is_on_earth(const Geodetic& place) {
  return std::abs(place.longitude) <= 180 && std::abs(place.latitude) <= 90 &&
         std::abs(place.height) <= kHighest;
}

Vec3d ecef_of(const Geodetic& place) {
  const double phi = place.latitude * kRadians, lambda = place.longitude * kRadians;
  const double N = transverse_radius(std::sin(phi));
  const double radius = (N + place.height) * std::cos(phi);
  return {radius * std::cos(lambda), radius * std::sin(lambda),
          (N * (1 - kSquaredEccentricity) + place.height) * std::sin(phi)};
}

Geodetic geodetic_of(const Vec3d& ecef) {
  const double radius = std::hypot(ecef.x, ecef.y);
  const double phi = latitude_of(radius, ecef.z);
  const double s = std::sin(phi), c = std::cos(phi);
  // The distance from the tangent plane: exact at the poles, too.
  const double height = radius * c + ecef.z * s - kEarthAxis * kEarthAxis / transverse_radius(s);
  return {std::atan2(ecef.y, ecef.x) / kRadians, phi / kRadians, height};
}

Mat3<double> enu_from_ecef(const Geodetic& place) {
  const double phi = place.latitude * kRadians, lambda = place.longitude * kRadians;
  const double sp = std::sin(phi), cp = std::cos(phi), sl = std::sin(lambda), cl = std::cos(lambda);
  return {{-sl, cl, 0}, {-sp * cl, -sp * sl, cp}, {cp * cl, cp * sl, sp}};
}

}  // namespace gs
