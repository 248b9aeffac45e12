// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/undistort_scene.h"

#include <gmock/gmock.h>

#include <cmath>

#include "data_loaders/lenses/undistort.h"
#include "data_loaders/photos/encode/encode_png.h"
#include "gs_core/error.h"
#include "tests/support/colmap_writer.h"
#include "tests/support/error_of.h"
#include "tests/support/folder_test.h"
#include "tests/support/foreign_leaks.h"

namespace gs {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

constexpr int kWidth = 60, kHeight = 40;

DatasetConfig dataset_at(const std::filesystem::path& folder, int resolution = 1) {
  DatasetConfig dataset;
  dataset.source = folder.string();
  dataset.resolution = resolution;
  return dataset;
}

/// Smooth colors that differ in each photo.
Image8 photo_of(int number) {
  Image8 photo(kWidth, kHeight, 3);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (int c = 0; c < 3; ++c)
        photo.at(x, y, c) =
            std::uint8_t(128 + 100 * std::sin(0.2 * x + 0.13 * y + c + 0.7 * number));
  return photo;
}

/// Photos a.png and sub/b.png with a lens, and c.png without one; a point that the first two show
/// at the center of their lens; and a mask of b.
ColmapModel write_lens_scene(const std::filesystem::path& folder) {
  ColmapModel model = small_model(3);
  model.cameras[7] = {7, CameraModel::simple_radial, kWidth, kHeight, {50, 31, 19, -0.1}};
  model.cameras[9] = {9, CameraModel::pinhole, kWidth, kHeight, {50, 51, 29, 21}};
  model.images[1].name = "sub/b.png";
  model.images[2].camera_id = 9;
  for (int i = 0; i < 2; ++i) model.images[i].observations = {{5, 31, 19}};
  write_binary_model(folder / "sparse/0", model);
  for (int i = 0; i < 3; ++i) write_png(folder / "images" / model.images[i].name, photo_of(i));
  Image8 mask(kWidth, kHeight, 1);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < 30; ++x) mask.at(x, y, 0) = 255;
  write_png(folder / "masks/sub/b.png", mask);
  return model;
}

std::string without_ending(const std::string& name) {
  return std::filesystem::path(name).replace_extension().string();
}

void expect_same_views(const Scene& a, const Scene& b) {
  ASSERT_EQ(a.train_views.size(), b.train_views.size());
  for (std::size_t i = 0; i < a.train_views.size(); ++i) {
    const View &x = a.train_views[i], &y = b.train_views[i];
    EXPECT_EQ(without_ending(x.name), without_ending(y.name));
    EXPECT_EQ(x.photo.pixels, y.photo.pixels) << x.name;
    EXPECT_EQ(x.mask.pixels, y.mask.pixels) << x.name;
    EXPECT_EQ(x.camera.width, y.camera.width);
    EXPECT_EQ(x.camera.height, y.camera.height);
    EXPECT_EQ(x.camera.fx, y.camera.fx);
    EXPECT_EQ(x.camera.fy, y.camera.fy);
    EXPECT_EQ(x.camera.cx, y.camera.cx);
    EXPECT_EQ(x.camera.cy, y.camera.cy);
    EXPECT_EQ(x.camera.position(), y.camera.position());
  }
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    EXPECT_EQ(a.points[i].position, b.points[i].position);
    EXPECT_EQ(a.points[i].color, b.points[i].color);
  }
}

class UndistortScene : public FolderTest {
 protected:
  UndistortedScene undistorted(int jpeg_quality = 0) {
    return undistort_scene(dataset_at(path("scene")), path("copy"), jpeg_quality);
  }
};

TEST_F(UndistortScene, CopyLoadsAsTheSameViewsAtEveryResolution) {
  write_lens_scene(path("scene"));
  const UndistortedScene result = undistorted();
  EXPECT_EQ(result.undistorted, 2u);
  EXPECT_EQ(result.copied, 1u);
  EXPECT_EQ(result.masks, 1u);
  for (const int resolution : {1, 2, 25})
    expect_same_views(load_scene(dataset_at(path("scene"), resolution)),
                      load_scene(dataset_at(path("copy"), resolution)));
}

TEST_F(UndistortScene, ModelHasPinholesOnlyAndKeepsTracks) {
  write_lens_scene(path("scene"));
  undistorted();
  const ColmapModel model = read_colmap_model(path("copy/sparse/0"), Tracks::read);
  for (const auto& [id, camera] : model.cameras) EXPECT_EQ(camera.model, CameraModel::pinhole);
  ASSERT_EQ(model.images.size(), 3u);
  for (const ColmapImage& image : model.images) {
    if (image.name == "c.png") continue;
    const ColmapCamera& camera = model.cameras.at(image.camera_id);
    ASSERT_EQ(image.observations.size(), 1u);
    EXPECT_EQ(image.observations[0].point_id, 5u);
    EXPECT_NEAR(image.observations[0].x, camera.params[2], 1e-6);  // the center stays the center
    EXPECT_NEAR(image.observations[0].y, camera.params[3], 1e-6);
  }
  EXPECT_EQ(model.points[0].observations, 2u);
}

TEST_F(UndistortScene, KeepsRigsAndFrames) {
  ColmapModel model = small_model(2);
  model.cameras[8] = model.cameras[7];
  model.cameras[8].id = 8;
  model.images[1].camera_id = 8;
  model.rigs.push_back(
      {4, {{7, true, {1, 0, 0, 0}, {0.0, 0.0, 0.0}}, {8, true, {1, 0, 0, 0}, {-1.0, 0.0, 0.0}}}});
  model.frames.push_back({1, 4, {1, 2}});
  write_scene(path("scene"), model);
  undistorted();
  const ColmapModel copy = read_colmap_model(path("copy/sparse/0"));
  ASSERT_EQ(copy.rigs.size(), 1u);
  ASSERT_EQ(copy.rigs[0].cameras.size(), 2u);
  EXPECT_EQ(copy.rigs[0].cameras[1].cam_from_rig_translation, Vec3d(-1.0, 0.0, 0.0));
  ASSERT_EQ(copy.frames.size(), 1u);
  EXPECT_THAT(copy.frames[0].image_ids, ElementsAre(1, 2));
}

TEST_F(UndistortScene, JpegStatesItsLoss) {
  write_lens_scene(path("scene"));
  const UndistortedScene result = undistorted(95);
  EXPECT_GT(result.jpeg_psnr, 30);
  EXPECT_LT(result.jpeg_psnr, 99);
  EXPECT_TRUE(std::filesystem::exists(path("copy/images/a.jpg")));
  EXPECT_TRUE(std::filesystem::exists(path("copy/images/c.png")));  // a copy
  EXPECT_EQ(load_scene(dataset_at(path("copy"))).train_views.size(), 3u);
}

TEST_F(UndistortScene, NothingIsOverwritten) {
  write_scene(path("scene"), small_model(1));
  write_bytes(path("copy/notes.txt"), "mine");
  EXPECT_THAT(error_of([&] { undistorted(); }), HasSubstr("nothing is overwritten"));
}

}  // namespace
}  // namespace gs
