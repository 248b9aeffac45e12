// SPDX-License-Identifier: Apache-2.0
// Depth maps, from their files to the views that are trained.
#include <gmock/gmock.h>

#include <cmath>

#include "data_loaders/doctor/doctor.h"
#include "data_loaders/lenses/undistort.h"
#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/exr.h"
#include "data_loaders/scene/depth/depth_map.h"
#include "data_loaders/scene/load_scene.h"
#include "data_loaders/scene/undistort_scene.h"
#include "tests/support/depth_png.h"
#include "tests/support/load_scene.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::Each;
using testing::FloatEq;
using testing::HasSubstr;

constexpr int kWidth = 24, kHeight = 16;

ImageF flat_map(float value, int width = kWidth, int height = kHeight) {
  return ImageF(width, height, 1, value);
}

/// The depth that a camera at the origin sees: a slope, so that every pixel has its own.
double slope_depth(double x, double y) { return 2 + 0.05 * x + 0.03 * y; }

class DepthMaps : public SceneTest {
 protected:
  /// Photos named a.png, b.png, ..., whose cameras look along z from the origin, and points on the
  /// slope.
  /// With `tracks`, the model says that each photo shows all points.
  void write_photos(int count, CameraModel lens = CameraModel::pinhole, bool tracks = false) {
    ColmapModel model = small_model(count);
    model.points.clear();
    model.cameras[7] = {7, lens, kWidth, kHeight, {20, 20, 12, 8}};
    if (lens == CameraModel::simple_radial) model.cameras[7].params = {20, 12, 8, -0.15};
    for (ColmapImage& image : model.images) image.cam_from_world_translation = Vec3d(0.0);
    for (int i = 0; i < 60; ++i) {
      const double x = 1 + 22.0 * (i % 10) / 9, y = 1 + 14.0 * (i / 10) / 5;
      const double z = slope_depth(x, y);
      model.points.push_back(
          {std::uint64_t(i + 1), {(x - 12) / 20 * z, (y - 8) / 20 * z, z}, {90, 90, 90}});
      for (ColmapImage& image : model.images)
        if (tracks) image.observations.push_back({std::uint64_t(i + 1), x, y});
    }
    fs::remove_all(folder());
    write(model);
  }
  /// Writes depth/NAME.png with value(depth of the pixel), in steps.
  template <class Value>
  void write_slope(const std::string& name, Value&& value) {
    ImageF map = flat_map(0);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        map.at(x, y, 0) = float(value(slope_depth(x + 0.5, y + 0.5)));
    write_depth_png(folder() / "depth" / name, map);
  }
  DatasetConfig dataset(DepthKind kind = DepthKind::metric) const {
    DatasetConfig result = dataset_at(folder());
    result.depth_kind = kind;
    return result;
  }
  View view(const DatasetConfig& dataset, std::size_t i = 0) {
    return *with_photo(load_scene(dataset).train_views.at(i));
  }
};

// The names are those of masks, which masks_test.cpp tests, with "depth" for "mask".
TEST_F(DepthMaps, AreFoundByTheNamesOfTheirPhotosInThisFolderOrAnother) {
  for (const char* name : {"a.png.png", "a.depth.png", "a_depth.png"}) {
    SCOPED_TRACE(name);
    write_photos(2);
    write_depth_png(folder() / "depth" / name, flat_map(1500));
    const Scene scene = load_scene(dataset());
    EXPECT_TRUE(scene.train_views[0].has_depth_map);
    EXPECT_EQ(scene.train_views[0].depth.width, kWidth);
    EXPECT_THAT(scene.train_views[0].depth.pixels, Each(FloatEq(1.5f)));  // millimeters
    EXPECT_EQ(scene.train_views[0].depth_kind, DepthKind::metric);
    EXPECT_FALSE(scene.train_views[1].has_depth_map);
    EXPECT_TRUE(scene.train_views[1].depth.empty());
  }
  write_depth_png(folder() / "sensor/a.png", flat_map(3000));
  DatasetConfig other = dataset();
  other.depth = "sensor";
  EXPECT_THAT(view(other).depth.pixels, Each(FloatEq(3.0f)));
  other.depth = "none";
  EXPECT_FALSE(view(other).has_depth_map);
  other.depth = "lidar";
  EXPECT_THAT(error_of(other), AllOf(HasSubstr("there is no folder"), HasSubstr("lidar"),
                                     HasSubstr("dataset.depth=none")));
}

TEST_F(DepthMaps, HaveTheUnitThatIsSaid) {
  write_photos(1);
  write_depth_png(folder() / "depth/a.png", flat_map(1000));
  DatasetConfig tenths = dataset();
  tenths.depth_unit = 1e-4f;
  EXPECT_THAT(view(tenths).depth.pixels, Each(FloatEq(0.1f)));
  EXPECT_THAT(view(dataset(DepthKind::inverse)).depth.pixels, Each(FloatEq(1000.0f)))
      << "has no unit";
}

TEST_F(DepthMaps, OfFloatsAreInWorldUnits) {
  if (!can_write_exr()) GTEST_SKIP() << cannot_write_exr();
  write_photos(1);
  ImageF map(kWidth, kHeight, 4, 0.5f);  // R, G, B and the depth
  for (std::size_t i = 3; i < map.pixels.size(); i += 4) map.pixels[i] = 2.75f;
  fs::create_directories(folder() / "depth");
  write_exr(folder() / "depth/a.exr", map, {"R", "G", "B", "Depth.Z"});
  EXPECT_THAT(view(dataset()).depth.pixels, Each(FloatEq(2.75f)));
}

TEST_F(DepthMaps, KnowNothingWhereTheyAreZeroOrNotFinite) {
  if (!can_write_exr()) GTEST_SKIP() << cannot_write_exr();
  write_photos(1);
  ImageF map = flat_map(2);
  map.at(3, 4, 0) = 0;
  map.at(5, 6, 0) = std::numeric_limits<float>::infinity();
  map.at(7, 8, 0) = std::numeric_limits<float>::quiet_NaN();
  map.at(9, 10, 0) = -1;
  fs::create_directories(folder() / "depth");
  write_exr(folder() / "depth/a.exr", map, {"Z"});
  const ImageF depth = view(dataset()).depth;
  for (const int x : {3, 5, 7, 9}) EXPECT_EQ(depth.at(x, x + 1, 0), 0);
  EXPECT_EQ(depth.at(4, 4, 0), 2);
}

TEST_F(DepthMaps, InColorsAreRefused) {
  write_photos(1);
  ImageF colors(kWidth, kHeight, 3, 100);
  write_depth_png(folder() / "depth/a.png", colors);  // gray in three channels
  EXPECT_THAT(view(dataset()).depth.pixels, Each(FloatEq(0.1f)));
  colors.at(4, 4, 1) = 200;
  write_depth_png(folder() / "depth/a.png", colors);
  EXPECT_THAT(error_of(dataset()), AllOf(HasSubstr("cannot read depth map"), HasSubstr("a.png"),
                                         HasSubstr("picture in colors"), HasSubstr("16 bits")));
}

TEST_F(DepthMaps, ThatAreDamagedAreRefusedByName) {
  write_photos(1);
  write_depth_png(folder() / "depth/a.png", flat_map(1000));
  std::string bytes = read_bytes(folder() / "depth/a.png");
  write_bytes(folder() / "depth/a.png", bytes.substr(0, bytes.size() / 2));
  EXPECT_THAT(error_of(dataset()), AllOf(HasSubstr("cannot read depth map"), HasSubstr("a.png"),
                                         HasSubstr("dataset.depth=none")));
}

TEST_F(DepthMaps, OfAnotherShapeAreRefusedBeforeAPhotoIsDecoded) {
  write_photos(1);
  write_depth_png(folder() / "depth/a.png", flat_map(1000, kHeight, kWidth));
  EXPECT_THAT(error_of(dataset()), AllOf(HasSubstr("depth map"), HasSubstr("16 x 24"),
                                         HasSubstr("24 x 16"), HasSubstr("shapes differ")));
}

TEST_F(DepthMaps, OfAnotherSizeAndResolutionAreSeenByTheViewsCamera) {
  write_photos(1);
  for (const int factor : {1, 2, 3}) {  // maps smaller or larger than the photo
    ImageF map(kWidth * factor / 2, kHeight * factor / 2, 1);
    for (int y = 0; y < map.height; ++y)
      for (int x = 0; x < map.width; ++x)
        map.at(x, y, 0) = float(1e4 * slope_depth((x + 0.5) * 2 / factor, (y + 0.5) * 2 / factor));
    write_depth_png(folder() / "depth/a.png", map);
    for (const int resolution : {1, 2}) {
      DatasetConfig reduced = dataset();
      reduced.depth_unit = 1e-4f;
      reduced.resolution = resolution;
      const View seen = view(reduced);
      ASSERT_EQ(seen.depth.width, seen.camera.width);
      for (int y = 1; y < seen.depth.height - 1; ++y)
        for (int x = 1; x < seen.depth.width - 1; ++x)
          EXPECT_NEAR(seen.depth.at(x, y, 0),
                      slope_depth((x + 0.5) * resolution, (y + 0.5) * resolution), 1e-3)
              << factor << " " << resolution;
    }
  }
}

TEST_F(DepthMaps, AreNotMixedOverAnEdge) {
  ImageF map(4, 1, 1);
  map.pixels = {1, 1.05f, 3, 0};
  EXPECT_FLOAT_EQ(depth_at(map, 0.5, 0), 1.025f);
  EXPECT_EQ(depth_at(map, 1.4, 0), 1.05f);
  EXPECT_EQ(depth_at(map, 1.6, 0), 3);
  EXPECT_EQ(depth_at(map, 2.4, 0), 3);
  EXPECT_EQ(depth_at(map, 2.6, 0), 0) << "not known";
  EXPECT_EQ(depth_at(map, -2, -1), 1);
}

// The undistorted view of a pixel shows the depth of the ray that the lens brings there.
TEST_F(DepthMaps, GoThroughTheLensWithThePhoto) {
  write_photos(1, CameraModel::simple_radial);
  ImageF map = flat_map(0);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) map.at(x, y, 0) = float(10000 + 100 * (x + 0.5));
  write_depth_png(folder() / "depth/a.png", map);
  const View seen = view(dataset(DepthKind::inverse));
  ASSERT_EQ(seen.depth.width, seen.camera.width);
  for (const auto& [x, y] : {std::pair{2, 1}, {12, 8}, {20, 10}}) {
    const double u = (x + 0.5 - seen.camera.cx) / seen.camera.fx,
                 v = (y + 0.5 - seen.camera.cy) / seen.camera.fy;
    const double column = 20 * u * (1 - 0.15 * (u * u + v * v)) + 12;
    EXPECT_NEAR(seen.depth.at(x, y, 0), 10000 + 100 * column, 1) << x << " " << y;
  }
}

TEST_F(DepthMaps, ComeWithPhotosThatAreDecodedInTime) {
  write_photos(6);
  for (char name = 'a'; name < 'g'; ++name)
    write_depth_png(folder() / "depth" / (std::string(1, name) + ".png"), flat_map(float(name)));
  DatasetConfig small = dataset(DepthKind::inverse);
  small.photo_cache = "none";
  small.photo_ram_gib = float(16e3 / double(1 << 30));  // two photos with maps
  const Scene scene = load_scene(small);
  ASSERT_TRUE(scene.train_views[0].source);
  EXPECT_TRUE(scene.train_views[0].depth.empty());
  EXPECT_EQ(map_bytes(scene.train_views[0]), 4u * kWidth * kHeight);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_TRUE(scene.train_views[i].has_depth_map);
    EXPECT_THAT(with_photo(scene.train_views[i])->depth.pixels, Each(float('a' + int(i))));
  }
}

TEST_F(DepthMaps, CountInTheBudgetOfPhotos) {
  write_photos(6);
  DatasetConfig tight = dataset();
  tight.photo_cache = "none";
  tight.masks = "none";
  tight.photo_ram_gib = float(13 * 3 * kWidth * kHeight / double(1 << 30));  // thirteen photos
  EXPECT_FALSE(load_scene(tight).train_views[0].source)
      << "six photos, and up to six being decoded";
  for (char name = 'a'; name < 'g'; ++name)
    write_depth_png(folder() / "depth" / (std::string(1, name) + ".png"), flat_map(1000));
  EXPECT_TRUE(load_scene(tight).train_views[0].source);
  tight.photo_ram_gib = float(3 * 3 * kWidth * kHeight / double(1 << 30));
  EXPECT_THAT(error_of(tight), HasSubstr("--photo-ram"));
}

// ---- what maps hold ----------------------------------------------------------------------------

TEST_F(DepthMaps, OfEachKindAreToldApartByTheSparsePoints) {
  struct Case {
    DepthKind kind;
    double (*value)(double depth);
  };
  const Case cases[] = {{DepthKind::metric, [](double depth) { return 1000 * depth; }},
                        {DepthKind::scaled, [](double depth) { return 3456 * depth; }},
                        {DepthKind::relative, [](double depth) { return 9000 * (depth - 1.9); }},
                        {DepthKind::inverse, [](double depth) { return 30000 / depth - 4000; }}};
  for (const Case& map : cases) {
    write_photos(2);
    for (const char* name : {"a.png", "b.png"}) write_slope(name, map.value);
    const DatasetConfig automatic = dataset(DepthKind::automatic);
    EXPECT_EQ(view(automatic).depth_kind, map.kind);
    EXPECT_THAT(log_of(automatic),
                AllOf(HasSubstr("2 of 2 photos have a depth map"), HasSubstr("tell")));
    EXPECT_EQ(view(dataset(DepthKind::inverse)).depth_kind, DepthKind::inverse) << "as it is said";
  }
}

// Scale and shift of a photo's map follow from the points that the photo shows.
TEST_F(DepthMaps, ComeToWorldUnitsByThePointsThatTheirPhotosShow) {
  struct Case {
    DepthKind kind;
    double (*value)(double depth);
  };
  const Case cases[] = {{DepthKind::scaled, [](double depth) { return 3456 * depth; }},
                        {DepthKind::relative, [](double depth) { return 9000 * (depth - 1.9); }},
                        {DepthKind::inverse, [](double depth) { return 90000 / depth - 4000; }}};
  for (const Case& map : cases) {
    write_photos(2, CameraModel::pinhole, true);
    for (const char* name : {"a.png", "b.png"}) write_slope(name, map.value);
    const View seen = view(dataset(DepthKind::automatic));
    EXPECT_EQ(seen.depth_kind, DepthKind::metric);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        EXPECT_NEAR(seen.depth.at(x, y, 0), slope_depth(x + 0.5, y + 0.5), 0.01) << int(map.kind);
    EXPECT_THAT(log_of(dataset(map.kind)), HasSubstr("bring 2 maps to world units"));
  }
  // A map that says the opposite stays what it is said to be.
  write_slope("a.png", [](double depth) { return 90000 / depth; });
  EXPECT_EQ(view(dataset(DepthKind::relative)).depth_kind, DepthKind::relative);
}

TEST_F(DepthMaps, ThatGoWithNothingAreLeftOutUnlessTheyAreNamed) {
  write_photos(2);
  for (const char* name : {"a.png", "b.png"})
    write_slope(name, [](double depth) { return 5000 + 4000 * std::sin(977 * depth); });
  DatasetConfig automatic = dataset(DepthKind::automatic);
  EXPECT_FALSE(view(automatic).has_depth_map);
  EXPECT_THAT(log_of(automatic), AllOf(HasSubstr("depth_kind"), HasSubstr("left out")));
  automatic.depth = "depth";
  EXPECT_THAT(error_of(automatic), AllOf(HasSubstr("do not tell"), HasSubstr("depth_kind=metric"),
                                         HasSubstr("dataset.depth=none")));
}

TEST_F(DepthMaps, OfNoPhotoAreRefusedIfTheyAreNamed) {
  write_photos(1);
  write_depth_png(folder() / "depth/other.png", flat_map(1000));
  DatasetConfig named = dataset();
  EXPECT_THAT(log_of(named), HasSubstr("is the depth map of a photo"));
  named.depth = "depth";
  EXPECT_THAT(error_of(named), AllOf(HasSubstr("none of the 1 pictures"), HasSubstr("a.png")));
}

TEST_F(DepthMaps, ThatTransformsJsonNamesAreTaken) {
  const std::string pose = "\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}";
  write_bytes(folder() / "transforms.json",
              "{\"camera_angle_x\": 0.8, \"frames\": [{\"file_path\": \"photos/a.png\", "
              "\"depth_file_path\": \"lidar/of_a.png\", " +
                  pose + ", {\"file_path\": \"photos/b.png\", " + pose + "]}");
  for (const char* name : {"photos/a.png", "photos/b.png"})
    write_png(folder() / name, plain_photo(kWidth, kHeight, 30));
  EXPECT_FALSE(view(dataset()).has_depth_map) << "the file is not there";
  write_depth_png(folder() / "lidar/of_a.png", flat_map(2000));
  EXPECT_THAT(view(dataset()).depth.pixels, Each(FloatEq(2.0f)));
  EXPECT_FALSE(view(dataset(), 1).has_depth_map);
  DatasetConfig none = dataset();
  none.depth = "none";
  EXPECT_FALSE(view(none).has_depth_map);
}

TEST_F(DepthMaps, AreUndistortedWithTheScene) {
  if (!can_write_exr()) GTEST_SKIP() << cannot_write_exr();
  write_photos(2, CameraModel::simple_radial);
  write_slope("a.png", [](double depth) { return 1000 * depth; });
  const fs::path copy = folder() / "copy";
  EXPECT_EQ(undistort_scene(dataset(), copy, 0).depth_maps, 1u);
  DatasetConfig of_copy = dataset_at(copy);
  of_copy.depth_kind = DepthKind::metric;
  EXPECT_EQ(view(of_copy).depth.pixels, view(dataset()).depth.pixels);
  EXPECT_FALSE(view(of_copy, 1).has_depth_map);
}

// ---- the doctor --------------------------------------------------------------------------------

std::string said_of_depth(const DatasetConfig& dataset, Finding::Level level) {
  Config config;
  config.dataset = dataset;
  std::string text;
  for (const Finding& finding : examine(config, true).findings)
    if (finding.topic == "depth" && finding.level == level) {
      text += finding.text + "\n";
      for (const std::string& name : finding.names) text += name + "\n";
    }
  return text;
}

TEST_F(DepthMaps, AreExaminedByTheDoctor) {
  using Level = Finding::Level;
  write_photos(3);
  for (const Level level : {Level::good, Level::note, Level::warning, Level::fatal})
    EXPECT_EQ(said_of_depth(dataset(), level), "") << "there are none";
  for (const char* name : {"a.png", "b.png"})
    write_slope(name, [](double depth) { return 1000 * depth; });
  const DatasetConfig automatic = dataset(DepthKind::automatic);
  EXPECT_THAT(said_of_depth(automatic, Level::good),
              AllOf(HasSubstr("2 of 3 photos have a depth map in"),
                    HasSubstr("depth in world units (rank correlation with depth 1.00")));
  EXPECT_THAT(said_of_depth(automatic, Level::note),
              AllOf(HasSubstr("1 photo has no depth map"), HasSubstr("c.png")));
  EXPECT_THAT(said_of_depth(dataset(DepthKind::inverse), Level::warning),
              AllOf(HasSubstr("depth_kind is inverse"), HasSubstr("auto")));
  write_depth_png(folder() / "depth/b.png", flat_map(100), 8);
  EXPECT_THAT(said_of_depth(automatic, Level::note), HasSubstr("256 different depths"));
  write_bytes(folder() / "depth/b.png", "no picture");
  EXPECT_THAT(said_of_depth(automatic, Level::fatal),
              AllOf(HasSubstr("1 of 3 depth maps cannot be read"), HasSubstr("b.png")));
}

}  // namespace
}  // namespace gs
