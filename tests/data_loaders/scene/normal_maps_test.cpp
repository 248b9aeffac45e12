// SPDX-License-Identifier: Apache-2.0
// Normal maps, from their files to the views that are trained.
#include <gmock/gmock.h>

#include <cmath>

#include "data_loaders/doctor/doctor.h"
#include "data_loaders/photos/exr.h"
#include "data_loaders/scene/normal_map.h"
#include "gs_core/config/config_words.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/normal_map.h"
#include "gs_core/math/render/rotation.h"
#include "tests/support/depth_png.h"
#include "tests/support/load_scene.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

constexpr int kWidth = 24, kHeight = 16;
// Of a map in 8 bits that is kept in 8 bits, and of an exact one.
constexpr float kOffByBytes = 0.012f, kOffByOurBytes = 0.007f;

/// The normal that a pixel shows, in the axes right, down and forward of its camera.
Vec3f normal_in_view(double x, double y) {
  const Vec3f n{float(0.4 - 0.03 * x), float(0.2 - 0.02 * y), -1};
  return n / length(n);
}

class NormalMaps : public SceneTest {
 protected:
  /// Photos named a.png, b.png, ..., whose cameras look about against the axis z of the world.
  void write_photos(int count, CameraModel lens = CameraModel::pinhole) {
    ColmapModel model = small_model(count);
    model.cameras[7] = {7, lens, kWidth, kHeight, {20, 20, 12, 8}};
    if (lens == CameraModel::simple_radial) model.cameras[7].params = {20, 12, 8, -0.15};
    for (ColmapImage& image : model.images) image.cam_from_world_rotation = turn_;
    for (ColmapPoint& point : model.points)
      point.position = multiply_transposed(rotation(), Vec3d(0.5, 0.0, 4.0));
    fs::remove_all(folder());
    write(model);
  }
  /// The picture of normals in these axes, from 0 to 1, where `scale` pixels lie in one of the photo.
  ImageF picture(NormalAxes axes = NormalAxes::rdf, double scale = 1) const {
    ImageF map(int(kWidth * scale), int(kHeight * scale), 3);
    for (int y = 0; y < map.height; ++y)
      for (int x = 0; x < map.width; ++x) {
        Vec3f n = normal_in_view((x + 0.5) / scale, (y + 0.5) / scale);
        if (axes == NormalAxes::world) n = Vec3f(multiply_transposed(rotation(), Vec3d(n)));
        if (axes == NormalAxes::rub) n = {n.x, -n.y, -n.z};
        if (axes == NormalAxes::lub) n = n * -1.0f;
        for (int c = 0; c < 3; ++c) map.at(x, y, c) = 0.5f + 0.5f * n[c];
      }
    return map;
  }
  void write_map(const std::string& name, ImageF map, int bits = 8) const {
    for (float& value : map.pixels) value *= float((1 << bits) - 1);
    write_depth_png(folder() / "normals" / name, map, bits);
  }
  DatasetConfig dataset(NormalAxes axes = NormalAxes::rdf) const {
    DatasetConfig result = dataset_at(folder());
    result.normal_axes = axes;
    return result;
  }
  static Scene load(const DatasetConfig& dataset) {
    return load_scene(dataset, {}, PhotoLoading::as_they_fit, {.normal_maps = true});
  }
  static std::string error_of(const DatasetConfig& dataset) {
    return gs::error_of([&] { load(dataset); });
  }
  static View view(const DatasetConfig& dataset, std::size_t i = 0) {
    return *with_photo(load(dataset).train_views.at(i));
  }
  static NormalBytes at(const View& view, int x, int y) {
    return NormalMap{view.normals.pixels.data(), view.normals.width}.at(x, y);
  }
  /// The largest difference from normal_in_view(), without the border.
  static float worst(const View& view, int reduced = 1) {
    EXPECT_EQ(view.normals.width, view.camera.width);
    float worst = 0;
    for (int y = 1; y < view.normals.height - 1; ++y)
      for (int x = 1; x < view.normals.width - 1; ++x) {
        EXPECT_TRUE(at(view, x, y).is_known());
        const Vec3f expected = normal_in_view((x + 0.5) * reduced, (y + 0.5) * reduced);
        worst = std::max(worst, length(at(view, x, y).normal() - expected));
      }
    return worst;
  }
  Mat3<double> rotation() const { return rotation_matrix(turn_); }

  const Quat<double> turn_{0.1, 0.1, 0.95, -0.2};
};

// The names are those of masks, which masks_test.cpp tests, with "normal" for "mask".
TEST_F(NormalMaps, AreFoundByTheNamesOfTheirPhotosInThisFolderOrAnother) {
  for (const char* name : {"a.png.png", "a.normal.png", "a_normal.png"}) {
    SCOPED_TRACE(name);
    write_photos(2);
    write_map(name, picture());
    const Scene scene = load(dataset());
    EXPECT_TRUE(scene.train_views[0].has_normal_map);
    EXPECT_LT(worst(scene.train_views[0]), kOffByBytes);
    EXPECT_FALSE(scene.train_views[1].has_normal_map);
    EXPECT_TRUE(scene.train_views[1].normals.empty());
    EXPECT_FALSE(load_scene(dataset()).train_views[0].has_normal_map) << "nobody needs it";
  }
  fs::rename(folder() / "normals", folder() / "priors");
  EXPECT_FALSE(view(dataset()).has_normal_map);
  DatasetConfig other = dataset();
  other.normals = "priors";
  EXPECT_TRUE(view(other).has_normal_map);
  other.normals = "none";
  EXPECT_FALSE(view(other).has_normal_map);
  other.normals = "sensor";
  EXPECT_THAT(error_of(other), AllOf(HasSubstr("there is no folder"), HasSubstr("sensor"),
                                     HasSubstr("dataset.normals=FOLDER")));
}

TEST_F(NormalMaps, HaveTheAxesThatAreSaid) {
  write_photos(1);
  for (const auto& [word, axes] : Words<NormalAxes>::kTable) {
    SCOPED_TRACE(word);
    write_map("a.png", picture(axes), 16);
    EXPECT_LT(worst(view(dataset(axes))), kOffByOurBytes);
  }
}

TEST_F(NormalMaps, ThatLookAwayFromTheirCamerasAreRefused) {
  write_photos(1);
  write_map("a.png", picture(NormalAxes::rdf));
  for (const NormalAxes axes : {NormalAxes::world, NormalAxes::rub, NormalAxes::lub})
    EXPECT_THAT(error_of(dataset(axes)),
                AllOf(HasSubstr("only 0 %"), HasSubstr("100 % with rdf"),
                      HasSubstr("dataset.normal_axes = \"" + std::string(word_of(axes)))));
}

// Of walls at the left and at the right, mirrored ones look away at the borders.
TEST_F(NormalMaps, OfARoomAreRefusedIfTheyAreMirrored) {
  write_photos(1);
  ImageF map(kWidth, kHeight, 3, 0.5f);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      map.at(x, y, 0) = x < kWidth / 2 ? 0.947f : 0.053f, map.at(x, y, 2) = 0.724f;
  write_map("a.png", map);
  EXPECT_TRUE(view(dataset(NormalAxes::rub)).has_normal_map);
  EXPECT_THAT(error_of(dataset(NormalAxes::lub)),
              AllOf(HasSubstr("only 83 %"), HasSubstr("--set dataset.normal_axes=rub")));
}

TEST_F(NormalMaps, OfFloatsAreNormalsAndHaveLayers) {
  if (!can_write_exr()) GTEST_SKIP() << cannot_write_exr();
  write_photos(1);
  fs::create_directories(folder() / "normals");
  ImageF normals = picture();
  for (float& value : normals.pixels) value = 2 * value - 1;
  write_exr(folder() / "normals/a.exr", normals, {"R", "G", "B"});
  EXPECT_LT(worst(view(dataset())), kOffByOurBytes);
  ImageF layers(kWidth, kHeight, 6, 0.5f);  // as of Blender: another layer comes first
  for (std::size_t i = 0; i < normals.pixels.size(); ++i)
    layers.pixels[6 * (i / 3) + 3 + i % 3] = normals.pixels[i];
  write_exr(folder() / "normals/a.exr", layers,
            {"View.Color.X", "View.Color.Y", "View.Color.Z", "View.Normal.X", "View.Normal.Y",
             "View.Normal.Z"});
  EXPECT_LT(worst(view(dataset())), kOffByOurBytes);
}

TEST_F(NormalMaps, SayNothingWhereTheyHaveNoNormal) {
  write_photos(1);
  ImageF map(kWidth, kHeight, 4, 1);  // with alpha
  const ImageF colors = picture();
  for (std::size_t i = 0; i < colors.pixels.size(); ++i)
    map.pixels[4 * (i / 3) + i % 3] = colors.pixels[i];
  const auto set = [&](int x, float value, float alpha) {
    for (int c = 0; c < 3; ++c) map.at(x, 3, c) = value;
    map.at(x, 3, 3) = alpha;
  };
  set(2, 0, 1), set(5, 1, 1), set(8, 0.5f, 1);
  map.at(11, 3, 3) = 0;
  write_map("a.png", map);
  const View seen = view(dataset());
  for (const int x : {2, 5, 8, 11}) EXPECT_FALSE(at(seen, x, 3).is_known()) << x;
  for (const int x : {1, 3, 12}) EXPECT_TRUE(at(seen, x, 3).is_known()) << x;
  if (!can_write_exr()) return;
  fs::remove(folder() / "normals/a.png");
  ImageF floats(kWidth, kHeight, 3, 0);
  for (std::size_t i = 2; i < floats.pixels.size(); i += 3) floats.pixels[i] = -1;
  floats.at(4, 4, 0) = std::numeric_limits<float>::quiet_NaN();
  floats.at(6, 4, 0) = std::numeric_limits<float>::infinity();
  write_exr(folder() / "normals/a.exr", floats, {"R", "G", "B"});
  const View of_floats = view(dataset());
  for (const int x : {4, 6}) EXPECT_FALSE(at(of_floats, x, 4).is_known()) << x;
  EXPECT_EQ(at(of_floats, 5, 4).z, 1);
}

TEST_F(NormalMaps, OfAnotherSizeAndResolutionAreSeenByTheViewsCamera) {
  write_photos(1);
  for (const double scale : {0.5, 1.5, 2.0}) {
    write_map("a.png", picture(NormalAxes::rdf, scale), 16);
    for (const int resolution : {1, 2}) {
      DatasetConfig reduced = dataset();
      reduced.resolution = resolution;
      EXPECT_LT(worst(view(reduced), resolution), 2 * kOffByOurBytes) << scale << " " << resolution;
    }
  }
}

TEST_F(NormalMaps, GoThroughTheLensWithThePhoto) {
  write_photos(1, CameraModel::simple_radial);
  write_map("a.png", picture(), 16);
  const View seen = view(dataset());
  for (const auto& [x, y] : {std::pair{3, 2}, {12, 8}, {20, 10}}) {
    const double u = (x + 0.5 - double(seen.camera.cx)) / double(seen.camera.fx),
                 v = (y + 0.5 - double(seen.camera.cy)) / double(seen.camera.fy);
    const double factor = 20 * (1 - 0.15 * (u * u + v * v));
    EXPECT_LT(length(at(seen, x, y).normal() - normal_in_view(factor * u + 12, factor * v + 8)),
              2 * kOffByOurBytes);
  }
}

TEST_F(NormalMaps, ComeWithPhotosThatAreDecodedInTime) {
  write_photos(6);
  for (char name = 'a'; name < 'g'; ++name) write_map(std::string(1, name) + ".png", picture());
  DatasetConfig small = dataset();
  small.photo_cache = "none";
  small.photo_ram_gib = float(40e3 / double(1 << 30));
  const Scene scene = load(small);
  ASSERT_TRUE(scene.train_views[0].source);
  EXPECT_TRUE(scene.train_views[0].normals.empty());
  EXPECT_TRUE(scene.train_views[0].has_normal_map);
  EXPECT_EQ(map_bytes(scene.train_views[0]), 3u * kWidth * kHeight);
  EXPECT_LT(worst(*with_photo(scene.train_views[5])), kOffByBytes);
}

TEST_F(NormalMaps, ThatCannotBeUsedAreRefusedByName) {
  write_photos(1);
  write_map("a.png", ImageF(kWidth, kHeight, 1, 0.5f));
  EXPECT_THAT(error_of(dataset()), AllOf(HasSubstr("cannot read normal map"), HasSubstr("a.png"),
                                         HasSubstr("gray"), HasSubstr("surface.prior_weight=0")));
  write_map("a.png", ImageF(kHeight, kWidth, 3, 0.5f));
  EXPECT_THAT(error_of(dataset()), AllOf(HasSubstr("normal map"), HasSubstr("16 x 24"),
                                         HasSubstr("24 x 16"), HasSubstr("shapes differ")));
  write_map("a.png", picture());
  const std::string bytes = read_bytes(folder() / "normals/a.png");
  write_bytes(folder() / "normals/a.png", bytes.substr(0, bytes.size() / 2));
  EXPECT_THAT(error_of(dataset()), AllOf(HasSubstr("cannot read normal map"), HasSubstr("a.png")));
  fs::remove(folder() / "normals/a.png");
  write_map("other.png", picture());
  DatasetConfig named = dataset();
  named.normals = "normals";
  EXPECT_THAT(error_of(named), AllOf(HasSubstr("none of the 1 pictures"), HasSubstr("a.png")));
}

TEST_F(NormalMaps, AreExaminedByTheDoctor) {
  using Level = Finding::Level;
  write_photos(2);
  write_map("a.png", picture());
  Config config;
  config.dataset = dataset();
  const auto said = [&](Level level) {
    std::string text;
    for (const Finding& finding : examine(config, true).findings)
      if (finding.level == level && (finding.topic == "normals" || finding.topic == "scene"))
        text += finding.text + "\n";
    return text;
  };
  EXPECT_THAT(said(Level::note), HasSubstr("surface.prior_weight is 0"));
  config.surface.prior_weight = 0.1f;
  EXPECT_THAT(said(Level::good), HasSubstr("1 of 2 photos have a normal map in"));
  EXPECT_THAT(said(Level::note), HasSubstr("1 photo has no normal map there"));
  EXPECT_EQ(said(Level::fatal), "");
  config.dataset.normal_axes = NormalAxes::rub;
  EXPECT_THAT(said(Level::fatal), HasSubstr("100 % with rdf"));
  write_bytes(folder() / "normals/a.png", "no picture");
  EXPECT_THAT(said(Level::fatal), HasSubstr("1 of 2 normal maps cannot be read"));
}

}  // namespace
}  // namespace gs
