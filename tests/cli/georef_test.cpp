// SPDX-License-Identifier: Apache-2.0
// gemsplat georef, on scenes of which it is known where on earth they stand.
#include <gmock/gmock.h>
#include <spdlog/fmt/fmt.h>

#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/georef/georef_file.h"
#include "tests/support/exif_photo.h"
#include "tests/support/placed_scene.h"
#include "tests/support/program.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class Georef : public Program {
 protected:
  /// A scene whose photos have the GPS tags of the truth, and the same places as text.
  void write_placed_scene() {
    const ColmapModel model = placed_model(9);
    write_binary_model(path("scene/sparse/0"), model);
    std::string lines;
    for (const ColmapImage& image : model.images) {
      const Geodetic at = geodetic_of(true_georeference().ecef_of_input(center_of(image)));
      write_gps_photo(path("scene/images") / image.name, 12, 8, at);
      lines += fmt::format("{} {} {} {}\n", image.name, at.latitude, at.longitude, at.height);
    }
    write_bytes(path("gps.txt"), lines);
  }
  double meters_off(const std::string& file) const {
    return meters_apart(read_georef(path(file)), true_georeference());
  }
};

TEST_F(Georef, PhotosWithGpsPlaceTheScene) {
  write_placed_scene();
  const Outcome outcome = run("georef " + text("scene"));
  if (outcome.err.find("OpenImageIO") != std::string::npos) {
    EXPECT_THAT(outcome.err, HasSubstr("--gps"));
    GTEST_SKIP() << "this build reads no EXIF";
  }
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out,
              AllOf(HasSubstr("9 of 9 cameras"), HasSubstr("one unit of the scene is 7.5")));
  EXPECT_THAT(outcome.err, HasSubstr("--heights sea-level"));
  EXPECT_LT(meters_off("scene/georef.json"), 0.1);
  EXPECT_EQ(json("scene/georef.json").at("cameras"), 9);
}

TEST_F(Georef, AFileOfPlacesDoesTheSame) {
  write_placed_scene();
  const Outcome outcome =
      run("georef " + text("scene") + " --gps " + text("gps.txt") + " -o " + text("at.json"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_LT(meters_off("at.json"), 0.001);
}

TEST_F(Georef, NothingIsOverwrittenWithoutForce) {
  write_placed_scene();
  write_bytes(path("scene/georef.json"), "mine");
  const std::string command = "georef " + text("scene") + " --gps " + text("gps.txt");
  const Outcome refused = run(command);
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("--force"));
  EXPECT_EQ(read_bytes(path("scene/georef.json")), "mine");
  ASSERT_EQ(run(command + " --force").code, 0);
  EXPECT_EQ(read_bytes(path("scene/georef.json.bak-1")), "mine");
  EXPECT_LT(meters_off("scene/georef.json"), 0.001);
}

TEST_F(Georef, AnOriginTakesCoordinatesAsTheyAre) {
  write_placed_scene();
  ASSERT_EQ(run("georef " + text("scene") +
                " --origin 15.5,48.2,252.5 --heights sea-level --geoid "
                "47.5")
                .code,
            0);
  const Georeference found = read_georef(path("scene/georef.json"));
  EXPECT_EQ(found.origin.height, 300);
  EXPECT_EQ(found.enu_from_input(Vec3d(1.0, 2.0, 3.0)), Vec3d(1.0, 2.0, 3.0));
}

TEST_F(Georef, WrongFlagsNameTheRemedy) {
  write_placed_scene();
  const std::string command = "georef " + text("scene") + " ";
  for (const auto& [flags, word] : {std::pair{"--crs EPSG:4978 --origin 1,2,3", "give one"},
                                    {"--heights sea-level", "--geoid"},
                                    {"--geoid 40", "--heights"},
                                    {"--crs utm", "EPSG:32633"},
                                    {"--crs EPSG:31468", "EPSG:4978"},
                                    {"--crs EPSG:32633", "--origin"},
                                    {"--origin 15,95,0", "LATITUDE"},
                                    {"--gps missing.txt", "missing.txt"}}) {
    const Outcome outcome = run(command + flags);
    EXPECT_NE(outcome.code, 0) << flags;
    EXPECT_THAT(outcome.err, HasSubstr(word)) << flags;
    EXPECT_FALSE(std::filesystem::exists(path("scene/georef.json"))) << flags;
  }
}

}  // namespace
}  // namespace gs
