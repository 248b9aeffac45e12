// SPDX-License-Identifier: Apache-2.0
// Georeferences found from GPS places and from coordinate systems, against the truth, and
// georef.json.
#include <gmock/gmock.h>

#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/georef/find_georeference.h"
#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/photos.h"
#include "gs_core/geodesy/utm.h"
#include "gs_core/geometry/vectors.h"
#include "tests/support/error_of.h"
#include "tests/support/exif_photo.h"
#include "tests/support/placed_scene.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr double kWithin = 0.1;  // meters, what georeferencing promises

bool reads_exif() {
  TempFolder folder;
  try {
    write_gps_photo(folder.path() / "a.jpg", 12, 8, {1, 2, 3});
    return read_photo_place(folder.path() / "a.jpg").has_value();
  } catch (const Error&) {
    return false;
  }
}

Geodetic true_place(const ColmapImage& image) {
  return geodetic_of(true_georeference().ecef_of_input(center_of(image)));
}

/// Places with normal errors of this size along each axis.
GpsPlaces places_of(const ColmapModel& model, double error = 0) {
  GpsPlaces places;
  std::uint64_t i = 0;
  for (const ColmapImage& image : model.images) {
    const Vec4f n = Random{9, RandomStream::test}.normal4(i++);
    places[image.name] = geodetic_of(ecef_of(true_place(image)) + error * Vec3d(n.x, n.y, n.z));
  }
  return places;
}

TEST(PhotoPlace, IsThatOfTheGpsTags) {
  if (!reads_exif()) GTEST_SKIP() << "this build reads no EXIF";
  TempFolder folder;
  for (const Geodetic& place : {Geodetic{15.5123456789, 48.2000001, 312.345},
                                Geodetic{-70.25, -53.0001, -12.5}, Geodetic{0, 0, 0}}) {
    write_gps_photo(folder.path() / "photo.jpg", 12, 8, place);
    const auto found = read_photo_place(folder.path() / "photo.jpg");
    ASSERT_TRUE(found);
    EXPECT_LT(length(ecef_of(*found) - ecef_of(place)), 0.002);  // floats of 60 seconds
  }
}

TEST(PhotoPlace, IsNoneWithoutTagsAndOffTheEarth) {
  if (!reads_exif()) GTEST_SKIP() << "this build reads no EXIF";
  TempFolder folder;
  write_png(folder.path() / "plain.png", plain_photo(12, 8, 50));
  EXPECT_FALSE(read_photo_place(folder.path() / "plain.png"));
  write_gps_photo(folder.path() / "off.jpg", 12, 8, {15, 95, 0});
  EXPECT_FALSE(read_photo_place(folder.path() / "off.jpg"));
}

TEST(PhotoPlace, IsRefusedWithARemedyWithoutOpenImageIo) {
  if (reads_exif()) GTEST_SKIP() << "this build reads EXIF";
  TempFolder folder;
  write_png(folder.path() / "a.png", plain_photo(12, 8, 50));
  EXPECT_THAT(error_of([&] { read_photo_place(folder.path() / "a.png"); }),
              AllOf(HasSubstr("OpenImageIO"), HasSubstr("--gps")));
}

TEST(Georeference, PhotosWithExactGpsStandWhereTheyAre) {
  if (!reads_exif()) GTEST_SKIP() << "this build reads no EXIF";
  TempFolder folder;
  const ColmapModel model = placed_model(12);
  std::vector<std::string> names;
  std::vector<std::filesystem::path> photos;
  for (const ColmapImage& image : model.images) {
    names.push_back(image.name);
    photos.push_back(folder.path() / image.name);
    write_gps_photo(photos.back(), 12, 8, true_place(image));
  }
  const GpsFit fit = fit_to_gps(model, gps_places_of_photos(names, photos), {});
  EXPECT_LT(meters_apart(fit.georeference, true_georeference()), kWithin);
  EXPECT_EQ(fit.quality.cameras, 12u);
  EXPECT_EQ(fit.quality.fitting, 12u);
  EXPECT_LT(fit.quality.rms, 0.01);
}

TEST(Georeference, NoiseIsAveragedAndWrongPlacesAreNamed) {
  const ColmapModel model = placed_model(150);
  GpsPlaces places = places_of(model, 0.3);
  places["photo_3.jpg"].latitude += 0.01;
  places["photo_40.jpg"].height -= 60;
  const GpsFit fit = fit_to_gps(model, places, {});
  EXPECT_THAT(fit.outliers, ElementsAre("photo_3.jpg", "photo_40.jpg"));
  EXPECT_NEAR(fit.quality.rms, 0.3 * std::sqrt(3.0), 0.06);
  // 0.3 m / sqrt(148) = 0.025 m of error is left of the shift along each axis. Across the cameras,
  // 24 m wide, it turns by 0.001 about each axis, or 0.12 m at a corner 65 m away. Twice the sum of
  // both is far from likely.
  EXPECT_LT(meters_apart(fit.georeference, true_georeference()), 2 * (0.045 + 0.12));
}

TEST(Georeference, HeightsAboveTheSeaGetTheGeoid) {
  const ColmapModel model = placed_model(12);
  GpsPlaces places = places_of(model);
  for (auto& [name, place] : places) place.height -= 47.5;
  const GpsFit fit = fit_to_gps(model, places, {5, 47.5});
  EXPECT_LT(meters_apart(fit.georeference, true_georeference()), 0.001);
}

TEST(Georeference, TooFewAndDisagreeingPlacesAreRefused) {
  const ColmapModel model = placed_model(12);
  GpsPlaces places = places_of(model);
  const GpsPlaces two(places.begin(), std::next(places.begin(), 2));
  EXPECT_THAT(error_of([&] { fit_to_gps(model, two, {}); }),
              AllOf(HasSubstr("only 2 of 12"), HasSubstr("--gps"), HasSubstr("--crs")));
  std::uint32_t i = 0;
  for (auto& [name, place] : places)
    place.latitude += 0.01 * Random{1, RandomStream::test}.uniform4(i++).x;
  EXPECT_THAT(error_of([&] { fit_to_gps(model, places, {}); }), HasSubstr("--max-distance"));
}

TEST(Georeference, CamerasOnALineAreRefused) {
  ColmapModel model = small_model(20);
  GpsPlaces places;
  std::uint64_t i = 0;
  for (ColmapImage& image : model.images) {
    image.cam_from_world_translation.y += 0.01 * double(i % 3);  // 7.5 cm, and GPS is 1 m off
    const Vec4f n = Random{9, RandomStream::test}.normal4(i++);
    places[image.name] = geodetic_of(ecef_of(true_place(image)) + Vec3d(n.x, n.y, n.z));
  }
  EXPECT_THAT(error_of([&] { fit_to_gps(model, places, {}); }), HasSubstr("line"));
}

/// The model in the coordinates that `of` gives its camera centers; orientations stay.
template <class Of>
ColmapModel moved(ColmapModel model, const Of& of) {
  for (ColmapImage& image : model.images)
    image.cam_from_world_translation =
        -multiply(rotation_matrix(image.cam_from_world_rotation), of(center_of(image)));
  return model;
}

TEST(Georeference, EarthCenteredCoordinatesStayWhatTheyAre) {
  const Georeference truth = true_georeference();
  const ColmapModel model =
      moved(placed_model(9), [&](const Vec3d& at) { return truth.ecef_of_input(at); });
  const Georeference found = georeference_of_epsg(model, 4978, 0);
  const Vec3d at = truth.ecef_of_input(Vec3d(3.0, 2.0, -4.0));
  EXPECT_LT(length(found.ecef_of_input(at) - at), 1e-6);
}

TEST(Georeference, UtmCoordinatesStandWhereProjSays) {
  const Vec3d at(600'000.0, 5'340'000.0, 252.5);
  const ColmapModel model =
      moved(placed_model(9), [&](const Vec3d& center) { return at + 10.0 * center; });
  const Georeference found = georeference_of_epsg(model, 32633, 47.5);
  // echo "600000 5340000" | cs2cs -f %.10f EPSG:32633 EPSG:4326; echo "600100 5339950" | ...
  // The origin is the median camera, some 10 m lower or higher, where heights get the scale 0.9997.
  EXPECT_LT(length(found.ecef_of_input(at) - ecef_of({16.3459269599, 48.2053484085, 300})), 0.005);
  const Vec3d beside = at + Vec3d(100.0, -50.0, 0.0);
  EXPECT_LT(length(found.ecef_of_input(beside) - ecef_of({16.3472607045, 48.2048829268, 300})),
            0.01);  // the earth curves by 1 mm on 112 m
}

TEST(Georeference, OtherSystemsAndPlacesOffTheEarthAreRefused) {
  const ColmapModel model = placed_model(9);
  EXPECT_THAT(error_of([&] { georeference_of_epsg(model, 25833, 0); }),
              AllOf(HasSubstr("EPSG:25833"), HasSubstr("EPSG:4978")));
  EXPECT_THAT(error_of([&] { georeference_of_epsg(model, 4978, 0); }), HasSubstr("--origin"));
  EXPECT_THAT(error_of([&] { georeference_of_epsg(model, 32633, 0); }), HasSubstr("--crs"));
}

TEST(GpsFile, LinesAreNamesAndPlaces) {
  TempFolder folder;
  const auto file = folder.path() / "gps.txt";
  write_bytes(file, "# name lat lon alt\n\na b.jpg 48.2 15.5 300\r\n  left/c.jpg\t-33 +151.5 -2.5");
  const GpsPlaces places = read_gps_file(file);
  ASSERT_EQ(places.size(), 2u);
  EXPECT_EQ(places.at("a b.jpg").latitude, 48.2);
  EXPECT_EQ(places.at("left/c.jpg").longitude, 151.5);
  EXPECT_EQ(places.at("left/c.jpg").height, -2.5);
}

TEST(GpsFile, ErrorsNameTheLine) {
  TempFolder folder;
  const auto file = folder.path() / "gps.txt";
  for (const char* line : {"48 15 300", "a 48 15", "a 480 15 300", "a 48 x 300", "a nan 15 300"}) {
    write_bytes(file, std::string("# places\n") + line + "\n");
    EXPECT_THAT(error_of([&] { read_gps_file(file); }),
                AllOf(HasSubstr("gps.txt"), HasSubstr("line 2"), HasSubstr("NAME LATITUDE")))
        << line;
  }
  write_bytes(file, "a 48 15 300\na 48 15 301\n");
  EXPECT_THAT(error_of([&] { read_gps_file(file); }), HasSubstr("again"));
}

TEST(GeorefFile, ReadsWhatWasWritten) {
  TempFolder folder;
  const auto file = folder.path() / "georef.json";
  write_georef(file,
               {true_georeference(), "a test", "above the ellipsoid", GpsFitQuality{9, 8, 1}});
  EXPECT_LT(meters_apart(read_georef(file), true_georeference()), 1e-7);
}

TEST(GeorefFile, DamageIsNamedWithARemedy) {
  TempFolder folder;
  const auto file = folder.path() / "georef.json";
  write_georef(file, {true_georeference(), "a test", "above the ellipsoid"});
  const std::string good = read_bytes(file);
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    const std::size_t at = text.find(from);
    EXPECT_NE(at, text.npos) << from;
    write_bytes(file, text.replace(at, from.size(), to));
    return error_of([&] { read_georef(file); });
  };
  const auto has_remedy = HasSubstr("gemsplat georef");
  EXPECT_THAT(with("\"version\": 1", "\"version\": 2"), AllOf(HasSubstr("version 2"), has_remedy));
  EXPECT_THAT(with("48.2", "148.2"), AllOf(HasSubstr("origin"), has_remedy));
  EXPECT_THAT(with("48.2,", ""), AllOf(HasSubstr("origin"), has_remedy));
  EXPECT_THAT(with("-30.0", "-30.0, 1"), AllOf(HasSubstr("enu_from_input"), has_remedy));
  EXPECT_THAT(with("-30.0", "\"x\""), has_remedy);
  EXPECT_THAT(with("enu_from_input", "enu"), has_remedy);
  write_bytes(file,
              "{\"version\": 1, \"origin\": [1, 2, 3], \"enu_from_input\": [[1,0,0,0],[0,2,0,"
              "0],[0,0,1,0],[0,0,0,1]]}");
  EXPECT_THAT(error_of([&] { read_georef(file); }), HasSubstr("enu_from_input"));
}

}  // namespace
}  // namespace gs
