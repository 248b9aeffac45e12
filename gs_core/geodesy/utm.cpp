// SPDX-License-Identifier: Apache-2.0
#include "gs_core/geodesy/utm.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "gs_core/geometry/vectors.h"

namespace gs {
namespace {

constexpr double kCentralScale = 0.9996;
constexpr double kFalseEasting = 500'000, kFalseNorthing = 10'000'000;  // meters; the latter south
constexpr double kDegrees = 180 / std::numbers::pi;
constexpr int kOrder = 6;

/// The third flattening, n = f / (2 - f).
constexpr double kN = kEarthFlattening / (2 - kEarthFlattening);

/// A: the radius of the circle as long as a meridian.   meters; Karney 2011, Eq. 14
constexpr double rectifying_radius() {
  constexpr double n2 = kN * kN;
  return kEarthAxis / (1 + kN) * (1 + n2 / 4 + n2 * n2 / 64 + n2 * n2 * n2 / 256);
}

/// beta_1 to beta_6, polynomials in n.   Karney 2011, Eq. 36
std::array<double, kOrder> inverse_series() {
  const double n = kN, n2 = n * n, n3 = n2 * n, n4 = n3 * n, n5 = n4 * n, n6 = n5 * n;
  return {n / 2 - 2 * n2 / 3 + 37 * n3 / 96 - n4 / 360 - 81 * n5 / 512 + 96199 * n6 / 604800,
          n2 / 48 + n3 / 15 - 437 * n4 / 1440 + 46 * n5 / 105 - 1118711 * n6 / 3870720,
          17 * n3 / 480 - 37 * n4 / 840 - 209 * n5 / 4480 + 5569 * n6 / 90720,
          4397 * n4 / 161280 - 11 * n5 / 504 - 830251 * n6 / 7257600,
          4583 * n5 / 161280 - 108847 * n6 / 3991680,
          20648693 * n6 / 638668800};
}

/// tan phi of the conformal latitude's tangent, by Newton's method.   Karney 2011, Eqs. 19 to 21
double tangent_of_latitude(double conformal) {
  const double e2 = kEarthFlattening * (2 - kEarthFlattening), e = std::sqrt(e2);
  constexpr int kMostRounds = 8;  // two or three do
  double tau = conformal;
  for (int round = 0; round < kMostRounds; ++round) {
    const double sigma = std::sinh(e * std::atanh(e * tau / std::hypot(1.0, tau)));
    const double reached = tau * std::hypot(1.0, sigma) - sigma * std::hypot(1.0, tau);
    const double step = (conformal - reached) / std::hypot(1.0, reached) *
                        (1 + (1 - e2) * tau * tau) / ((1 - e2) * std::hypot(1.0, tau));
    tau += step;
    if (!(std::abs(step) > 1e-15 * std::abs(tau))) break;
  }
  return tau;
}

}  // namespace

std::optional<UtmZone> utm_zone_of_epsg(int code) {
  const int number = code % 100;
  const bool is_utm = (code / 100 == 326 || code / 100 == 327) && number >= 1 && number <= 60;
  if (!is_utm) return {};
  return UtmZone{number, code / 100 == 327};
}

Geodetic geodetic_of_utm(const UtmZone& zone, const Vec3d& coordinates) {
  const double radius = kCentralScale * rectifying_radius();
  const double xi = (coordinates.y - (zone.is_south ? kFalseNorthing : 0)) / radius;
  const double eta = (coordinates.x - kFalseEasting) / radius;
  const std::array<double, kOrder> beta = inverse_series();
  double xi_sphere = xi, eta_sphere = eta;
  for (int j = 1; j <= kOrder; ++j) {
    xi_sphere -= beta[j - 1] * std::sin(2 * j * xi) * std::cosh(2 * j * eta);
    eta_sphere -= beta[j - 1] * std::cos(2 * j * xi) * std::sinh(2 * j * eta);
  }
  const double across = std::sinh(eta_sphere), along = std::cos(xi_sphere);
  const double tau = tangent_of_latitude(std::sin(xi_sphere) / std::hypot(across, along));
  const double longitude = 6.0 * zone.number - 183 + std::atan2(across, along) * kDegrees;
  return {std::remainder(longitude, 360), std::atan(tau) * kDegrees, coordinates.z};
}

UtmFrame utm_frame_at(const UtmZone& zone, const Vec3d& coordinates) {
  constexpr double kStep = 100;  // meters: rounding is 1e-11 of it, the third derivative less
  const auto ecef_at = [&](double north) {
    return ecef_of(geodetic_of_utm(zone, coordinates + Vec3d(0.0, north, 0.0)));
  };
  UtmFrame frame;
  frame.place = geodetic_of_utm(zone, coordinates);
  const Vec3d on_ellipsoid =
      multiply(enu_from_ecef(frame.place), (ecef_at(kStep) - ecef_at(-kStep)) / (2 * kStep));
  frame.convergence = std::atan2(on_ellipsoid.x, on_ellipsoid.y);
  frame.scale = 1 / std::hypot(on_ellipsoid.x, on_ellipsoid.y);
  return frame;
}

UtmZone utm_zone_at(const Geodetic& place) {
  return {std::clamp(int(std::floor((place.longitude + 180) / 6)) + 1, 1, 60), place.latitude < 0};
}

Vec3d utm_of(const UtmZone& zone, const Geodetic& place) {
  constexpr int kMostRounds = 20;  // four or five do
  constexpr double kClose = 1e-7;  // meters
  const Vec3d wanted = ecef_of({place.longitude, place.latitude, 0});
  const double from_meridian = std::remainder(place.longitude - (6.0 * zone.number - 183), 360);
  const double meters = kEarthAxis / kDegrees;  // of a degree
  Vec3d at(kFalseEasting + from_meridian * meters * std::cos(place.latitude / kDegrees),
           place.latitude * meters + (zone.is_south ? kFalseNorthing : 0), 0.0);
  for (int round = 0; round < kMostRounds; ++round) {
    const UtmFrame frame = utm_frame_at(zone, at);
    const Vec3d away = multiply(enu_from_ecef(frame.place), wanted - ecef_of(frame.place));
    const double c = std::cos(frame.convergence), s = std::sin(frame.convergence);
    at += frame.scale * Vec3d(c * away.x - s * away.y, s * away.x + c * away.y, 0.0);
    if (std::hypot(away.x, away.y) < kClose) break;
  }
  return {at.x, at.y, place.height};
}

}  // namespace gs
