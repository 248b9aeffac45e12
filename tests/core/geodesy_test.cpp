// SPDX-License-Identifier: Apache-2.0
// Places on earth, against values that PROJ 9.1.1 (`cs2cs`, Debian proj-bin) has printed.
#include "gs_core/geodesy/utm.h"
#include "gs_core/geometry/vectors.h"
#include "tests/support/test.h"

namespace gs {
namespace {

constexpr double kDegree = 111'000;  // meters of a degree of latitude, about

/// Meters between two places; heights count.
double distance(const Geodetic& a, const Geodetic& b) { return length(ecef_of(a) - ecef_of(b)); }

// echo "48.2 15.5 300" | cs2cs -f %.6f EPSG:4979 EPSG:4978, and so on
TEST(Geodetic, EarthCenteredCoordinatesAreThoseOfProj) {
  EXPECT_LT(
      length(ecef_of({15.5, 48.2, 300}) - Vec3d(4104454.243643, 1138265.901733, 4731951.528420)),
      2e-6);
  EXPECT_LT(length(ecef_of({151.2, -33.87, -20}) -
                   Vec3d(-4645557.229919, 2553916.699176, -3534471.759322)),
            2e-6);
  EXPECT_LT(length(ecef_of({-30, 89.9, 8848}) - Vec3d(9686.351105, -5592.417418, 6365590.553633)),
            2e-6);
}

TEST(Geodetic, TheWayBackEndsWhereItBegan) {
  for (const double latitude : {-90.0, -89.9999, -45.0, -1e-7, 0.0, 12.3, 66.6, 90.0})
    for (const double longitude : {-179.5, -90.0, 0.0, 33.3, 180.0})
      for (const double height : {-11'000.0, 0.0, 8848.0, 400'000.0}) {
        const Geodetic place{longitude, latitude, height};
        EXPECT_LT(distance(geodetic_of(ecef_of(place)), place), 1e-8);
        EXPECT_NEAR(geodetic_of(ecef_of(place)).height, height, 1e-8);
      }
}

TEST(Geodetic, TheLocalFrameLooksEastNorthAndUp) {
  const Geodetic place{15.5, 48.2, 300};
  const Mat3<double> enu = enu_from_ecef(place);
  EXPECT_TRUE(is_rotation(enu, 1e-12));
  const double step = 1e-6;  // degrees, 11 cm
  const auto local = [&](const Geodetic& other) {
    return multiply(enu, ecef_of(other) - ecef_of(place));
  };
  const Vec3d east = local({place.longitude + step, place.latitude, place.height});
  const Vec3d north = local({place.longitude, place.latitude + step, place.height});
  const Vec3d up = local({place.longitude, place.latitude, place.height + 1});
  EXPECT_NEAR(east.x, step * kDegree * std::cos(48.2 * std::numbers::pi / 180), 0.001);
  EXPECT_NEAR(north.y, step * kDegree, 0.001);
  EXPECT_NEAR(up.z, 1, 1e-9);
  EXPECT_LT(std::abs(east.y) + std::abs(east.z) + std::abs(north.x) + std::abs(north.z), 1e-6);
}

TEST(Geodetic, PlacesOffTheEarthAreKnown) {
  EXPECT_TRUE(is_on_earth({-180, 90, -400}));
  EXPECT_FALSE(is_on_earth({181, 0, 0}));
  EXPECT_FALSE(is_on_earth({0, -91, 0}));
  EXPECT_FALSE(is_on_earth({0, 0, 2e6}));
  EXPECT_FALSE(is_on_earth({0, NAN, 0}));
}

// echo "600000 5340000" | cs2cs -f %.10f EPSG:32633 EPSG:4326, and so on
TEST(Utm, PlacesAreThoseOfProj) {
  struct Case {
    int epsg;
    Vec3d coordinates;
    Geodetic place;
  };
  const std::vector<Case> cases = {
      {32633, {600'000, 5'340'000, 300}, {16.3459269599, 48.2053484085, 300}},
      {32756, {334'786.5, 6'252'080.25, -3}, {151.2140283106, -33.8586617412, -3}},
      {32631, {166'021.4431, 0, 0}, {0.0000000002, 0, 0}},
      {32602, {250'000, 9'300'000, 0}, {169.2525101431, 83.3610701583, 0}},
      {32602, {950'000, 2'000'000, 5}, {-166.7513723453, 18.0419423822, 5}},
      {32633, {537'153.311222, 5'338'650.634532, 300}, {15.5, 48.2, 300}},
      {32719, {399'803.457830, 4'104'430.426730, 10}, {-70.5, -53.2, 10}},
  };
  for (const Case& c : cases) {
    const auto zone = utm_zone_of_epsg(c.epsg);
    ASSERT_TRUE(zone);
    // The printed digits are 1e-10 degrees, 11 micrometers.
    EXPECT_LT(distance(geodetic_of_utm(*zone, c.coordinates), c.place), 2e-5) << c.epsg;
  }
}

TEST(Utm, OnlyCodesOfUtmHaveAZone) {
  EXPECT_EQ(utm_zone_of_epsg(32601)->number, 1);
  EXPECT_FALSE(utm_zone_of_epsg(32660)->is_south);
  EXPECT_TRUE(utm_zone_of_epsg(32760)->is_south);
  for (const int code : {4326, 4978, 32600, 32661, 32700, 32761, 25833, -32633, 0})
    EXPECT_FALSE(utm_zone_of_epsg(code)) << code;
}

// echo 16.343 48.2 | proj -S +proj=utm +zone=33 +ellps=WGS84 prints the scale 0.999722; the
// convergence on a sphere is atan(tan(longitude - 15) sin(latitude)).
TEST(Utm, TheFrameHasTheScaleOfProjAndTheConvergence) {
  const UtmFrame frame = utm_frame_at({33, false}, {599'792.93, 5'339'401.74, 0});
  EXPECT_NEAR(frame.place.longitude, 16.343, 1e-7);
  EXPECT_NEAR(frame.scale, 0.999722, 1e-6);
  const double radians = std::numbers::pi / 180;
  EXPECT_NEAR(frame.convergence, std::atan(std::tan(1.343 * radians) * std::sin(48.2 * radians)),
              2e-6);
}

TEST(Utm, TheFrameLeadsFromGridMetersToMetersOnEarth) {
  const UtmZone zone{56, true};
  const Vec3d at{334'786.5, 6'252'080.25, 120}, step{30, 40, 5};
  const UtmFrame frame = utm_frame_at(zone, at);
  const Vec3d moved = multiply(enu_from_ecef(frame.place),
                               ecef_of(geodetic_of_utm(zone, at + step)) - ecef_of(frame.place));
  const double c = std::cos(frame.convergence), s = std::sin(frame.convergence);
  const Vec3d expected =
      Vec3d(c * step.x + s * step.y, -s * step.x + c * step.y, 0.0) / frame.scale;
  EXPECT_NEAR(moved.x, expected.x, 1e-3);
  EXPECT_NEAR(moved.y, expected.y, 1e-3);
  EXPECT_NEAR(moved.z, 5, 1e-3);
}

TEST(Utm, TheWayBackEndsWhereItBegan) {
  for (const double latitude : {-80.0, -33.9, -1e-4, 0.0, 48.2, 83.5})
    for (const double from_meridian : {-3.0, -1.234, 0.0, 2.9}) {
      const Geodetic place{15 + from_meridian, latitude, 123};
      const UtmZone zone = utm_zone_at(place);
      EXPECT_EQ(zone.number, 33);
      EXPECT_EQ(zone.is_south, latitude < 0);
      EXPECT_LT(distance(geodetic_of_utm(zone, utm_of(zone, place)), place), 1e-6) << latitude;
    }
  EXPECT_EQ(utm_zone_at({180, 0, 0}).number, 60);
}

}  // namespace
}  // namespace gs
