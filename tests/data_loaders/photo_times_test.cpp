// SPDX-License-Identifier: Apache-2.0
// Times of photos in scenes of COLMAP: films of cameras that stand still, and one film of a camera
// that moves.
#include "data_loaders/scene/photo_times.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "data_loaders/scene/load_scene.h"
#include "gs_core/error.h"
#include "tests/support/colmap_writer.h"
#include "tests/support/load_scene.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

/// A model of cameras cam0.png, cam1.png, ..., each with its frames in images/cam0, ...; a frame's
/// photo has the value 100 * camera + 10 * frame.
void write_films(const std::filesystem::path& folder, const std::vector<int>& frames) {
  ColmapModel model = small_model(int(frames.size()));
  for (std::size_t camera = 0; camera < frames.size(); ++camera) {
    const std::string name = "cam" + std::to_string(camera);
    model.images[camera].name = name + ".png";
    for (int frame = 0; frame < frames[camera]; ++frame)
      write_png(folder / "images" / name / (std::to_string(100 + frame) + ".png"),
                plain_photo(12, 8, std::uint8_t(100 * camera + 10 * frame)));
  }
  write_binary_model(folder / "sparse" / "0", model);
}

DatasetConfig dataset_at(const std::filesystem::path& folder, PhotoTimes times) {
  DatasetConfig dataset = gs::dataset_at(folder);
  dataset.times = times;
  return dataset;
}

TEST(FilmsOfCameras, BecomeViewsWithThePoseOfTheCameraAndTheTimeOfTheFrame) {
  const TempFolder temp;
  write_films(temp.path(), {3, 3});
  const Scene scene = load_scene(dataset_at(temp.path(), PhotoTimes::frames));
  EXPECT_EQ(scene.time_count, 3u);
  ASSERT_EQ(scene.train_views.size(), 6u);
  for (int i = 0; i < 6; ++i) {
    const View& view = scene.train_views[std::size_t(i)];
    const int camera = i / 3, frame = i % 3;
    EXPECT_EQ(view.name,
              "cam" + std::to_string(camera) + "/" + std::to_string(100 + frame) + ".png");
    EXPECT_EQ(view.camera.position(), Vec3f(float(camera), 0, 0));
    EXPECT_EQ(view.camera.time, 0.5f * float(frame));
    EXPECT_EQ(view.photo.pixels[0], 100 * camera + 10 * frame);
  }
}

TEST(FilmsOfCameras, AreHeldOutWhole) {
  const TempFolder temp;
  write_films(temp.path(), {2, 2, 2});
  DatasetConfig dataset = dataset_at(temp.path(), PhotoTimes::frames);
  dataset.eval = true;
  dataset.test_every = 3;
  const Scene scene = load_scene(dataset);
  ASSERT_EQ(scene.test_views.size(), 2u);
  EXPECT_EQ(scene.test_views[0].name, "cam0/100.png");
  EXPECT_EQ(scene.test_views[1].name, "cam0/101.png");
  EXPECT_EQ(scene.train_views.size(), 4u);
}

TEST(FilmsOfCameras, MayBeNamedByTheirFirstFrame) {
  const TempFolder temp;
  write_films(temp.path(), {2, 2});
  ColmapModel model = small_model(2);
  model.images[0].name = "cam0/100.png";
  model.images[1].name = "cam1/100.png";
  write_binary_model(temp.path() / "sparse" / "0", model);
  EXPECT_EQ(load_scene(dataset_at(temp.path(), PhotoTimes::frames)).train_views.size(), 4u);
}

TEST(FilmsOfCameras, OfDifferentLengthOrWithoutFramesAreRefused) {
  const TempFolder temp;
  write_films(temp.path(), {3, 2});
  EXPECT_THAT(error_of(dataset_at(temp.path(), PhotoTimes::frames)),
              AllOf(HasSubstr("cam1.png has 2 frames"), HasSubstr("cam0.png has 3")));
  const TempFolder other;
  write_films(other.path(), {3, 0});
  EXPECT_THAT(error_of(dataset_at(other.path(), PhotoTimes::frames)),
              AllOf(HasSubstr("cam1.png has no frames"), HasSubstr("ffmpeg -i VIDEO")));
}

TEST(FilmOfOneCamera, HasTheTimesOfTheNumbersInItsNames) {
  const TempFolder temp;
  ColmapModel model = small_model(3);
  model.images[0].name = "take2_0030.png";
  model.images[1].name = "take2_0010.png";
  model.images[2].name = "take2_0050.png";
  write_scene(temp.path(), model);
  const Scene scene = load_scene(dataset_at(temp.path(), PhotoTimes::names));
  EXPECT_EQ(scene.time_count, 3u);
  std::vector<float> times;
  for (const View& view : scene.train_views) times.push_back(view.camera.time);
  EXPECT_THAT(times, ElementsAre(0.0f, 0.5f, 1.0f));  // in the order of the names
}

TEST(FilmOfOneCamera, WithANameWithoutANumberIsRefused) {
  const TempFolder temp;
  write_scene(temp.path(), small_model(2));
  EXPECT_THAT(error_of(dataset_at(temp.path(), PhotoTimes::names)),
              AllOf(HasSubstr("a.png has no number"), HasSubstr("frame_0012.png")));
}

TEST(FilmsOfCameras, SeveralImagesOfOneCameraAreRefused) {
  const TempFolder temp;
  write_films(temp.path(), {3});
  ColmapModel model = small_model(2);
  model.images[0].name = "cam0/100.png";
  model.images[1].name = "cam0/101.png";
  write_binary_model(temp.path() / "sparse" / "0", model);
  EXPECT_THAT(error_of(dataset_at(temp.path(), PhotoTimes::frames)),
              HasSubstr("dataset.times = \"names\""));
}

}  // namespace
}  // namespace gs
