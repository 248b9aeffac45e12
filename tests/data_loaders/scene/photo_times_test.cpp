// SPDX-License-Identifier: Apache-2.0
// Times of photos in scenes of COLMAP: films of cameras that stand still, and one film of a camera
// that moves.
#include "data_loaders/scene/photo_times.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/photo_cache.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/scene/load_scene.h"
#include "data_loaders/scene/scene_hash.h"
#include "data_loaders/video/video_frames.h"
#include "gs_core/error.h"
#include "tests/support/avi_writer.h"
#include "tests/support/captured_log.h"
#include "tests/support/colmap_writer.h"
#include "tests/support/foreign_leaks.h"
#include "tests/support/load_scene.h"
#include "tests/support/scenes.h"

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

constexpr int kWidth = 12, kHeight = 8;

Image8 frame_of(int camera, int frame) {
  return random_photo(kWidth, kHeight, std::uint64_t(100 * camera + frame));
}

/// A model of cameras cam0.png, cam1.png, ..., each with its video images/cam0.avi, ..., of
/// frame_of().
void write_videos(const std::filesystem::path& folder, const std::vector<int>& frames) {
  ColmapModel model = small_model(int(frames.size()));
  for (std::size_t camera = 0; camera < frames.size(); ++camera) {
    const std::string name = "cam" + std::to_string(camera);
    model.images[camera].name = name + ".png";
    std::vector<Image8> video;
    for (int frame = 0; frame < frames[camera]; ++frame)
      video.push_back(frame_of(int(camera), frame));
    write_avi(folder / "images" / (name + ".avi"), video);
  }
  write_binary_model(folder / "sparse" / "0", model);
}

DatasetConfig dataset_at(const std::filesystem::path& folder, PhotoTimes times) {
  DatasetConfig dataset = gs::dataset_at(folder);
  dataset.times = times;
  return dataset;
}

class FilmsOfCameras : public SceneTest {};

TEST_F(FilmsOfCameras, BecomeViewsWithThePoseOfTheCameraAndTheTimeOfTheFrame) {
  write_films(folder(), {3, 3});
  const Scene scene = load_scene(dataset_at(folder(), PhotoTimes::frames));
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

TEST_F(FilmsOfCameras, AreHeldOutWhole) {
  write_films(folder(), {2, 2, 2});
  DatasetConfig dataset = dataset_at(folder(), PhotoTimes::frames);
  dataset.eval = true;
  dataset.test_every = 3;
  const Scene scene = load_scene(dataset);
  ASSERT_EQ(scene.test_views.size(), 2u);
  EXPECT_EQ(scene.test_views[0].name, "cam0/100.png");
  EXPECT_EQ(scene.test_views[1].name, "cam0/101.png");
  EXPECT_EQ(scene.train_views.size(), 4u);
}

TEST_F(FilmsOfCameras, MayBeNamedByTheirFirstFrame) {
  write_films(folder(), {2, 2});
  ColmapModel model = small_model(2);
  model.images[0].name = "cam0/100.png";
  model.images[1].name = "cam1/100.png";
  write_binary_model(folder() / "sparse" / "0", model);
  EXPECT_EQ(load_scene(dataset_at(folder(), PhotoTimes::frames)).train_views.size(), 4u);
}

TEST_F(FilmsOfCameras, OfDifferentLengthOrWithoutFramesAreRefused) {
  write_films(folder(), {3, 2});
  EXPECT_THAT(error_of(dataset_at(folder(), PhotoTimes::frames)),
              AllOf(HasSubstr("cam1.png has 2 frames"), HasSubstr("cam0.png has 3")));
  const TempFolder other;
  write_films(other.path(), {3, 0});
  EXPECT_THAT(error_of(dataset_at(other.path(), PhotoTimes::frames)),
              AllOf(HasSubstr("cam1.png has no frames"), HasSubstr("cam1.mp4")));
}

TEST_F(FilmsOfCameras, AreHeldOutByTheirNames) {
  write_films(folder(), {2, 2, 2});
  DatasetConfig dataset = dataset_at(folder(), PhotoTimes::frames);
  dataset.eval = true;
  dataset.test_names = "cam2.png, cam0";
  const Scene scene = load_scene(dataset);
  ASSERT_EQ(scene.test_views.size(), 4u);
  EXPECT_EQ(scene.test_views[0].name, "cam0/100.png");
  EXPECT_EQ(scene.test_views[3].name, "cam2/101.png");
  EXPECT_EQ(scene.train_views.size(), 2u);
  dataset.test_names = "cam0,cam";
  EXPECT_THAT(error_of(dataset), AllOf(HasSubstr("has cam,"), HasSubstr("cam0.png")));
  dataset.test_names = "cam0,cam1,cam2";
  EXPECT_THAT(error_of(dataset), HasSubstr("no view is left"));
}

class VideosOfCameras : public testing::Test {
 protected:
  void SetUp() override {
    if (!can_read_videos()) GTEST_SKIP() << "built without OpenCV";
  }
  std::filesystem::path folder() const { return temp_.path() / "scene"; }
  std::filesystem::path cache() const { return temp_.path() / "cache"; }
  DatasetConfig dataset() const {
    DatasetConfig dataset = dataset_at(folder(), PhotoTimes::frames);
    dataset.photo_cache = "none";
    return dataset;
  }
  /// Memory for some of the frames only.
  DatasetConfig dataset_of_little_memory() const {
    DatasetConfig dataset = this->dataset();
    dataset.photo_ram_gib = 6000.0f / float(1 << 30);
    return dataset;
  }
  static void expect_frames(const Scene& scene, int frames_each) {
    const int count = int(scene.train_views.size());
    for (int k = 0; k < count; ++k) {
      const int i = 7 * k % count;  // in another order than that of the videos
      const View& view = scene.train_views[std::size_t(i)];
      EXPECT_EQ(with_photo(view)->photo.pixels, frame_of(i / frames_each, i % frames_each).pixels)
          << view.name;
    }
  }

  TempFolder temp_;
};

TEST_F(VideosOfCameras, BecomeViewsNamedAsFfmpegWouldNameTheFrames) {
  write_videos(folder(), {3, 3});
  const Scene scene = load_scene(dataset());
  EXPECT_EQ(scene.time_count, 3u);
  ASSERT_EQ(scene.train_views.size(), 6u);
  EXPECT_EQ(scene.train_views[0].name, "cam0/00001.png");
  EXPECT_EQ(scene.train_views[5].name, "cam1/00003.png");
  EXPECT_EQ(scene.train_views[4].camera.position(), Vec3f(1, 0, 0));
  EXPECT_EQ(scene.train_views[4].camera.time, 0.5f);
  EXPECT_EQ(scene.train_views[0].source, nullptr);  // they fit into memory
  expect_frames(scene, 3);
}

TEST_F(VideosOfCameras, BeyondTheMemoryAreTakenFromTheCache) {
  if (!can_cache_photos()) GTEST_SKIP() << "built without zstd or xxhash";
  write_videos(folder(), {10, 10});
  DatasetConfig dataset = dataset_of_little_memory();
  dataset.photo_cache = cache().string();
  const Scene scene = load_scene(dataset);
  ASSERT_EQ(scene.train_views.size(), 20u);
  EXPECT_NE(scene.train_views[0].source, nullptr);
  std::size_t entries = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(cache()))
    entries += entry.is_regular_file();
  EXPECT_EQ(entries, 20u);
  expect_frames(scene, 10);
  EXPECT_EQ(picture_names_in(folder() / "images").size(), 0u);  // nothing beside the videos
}

TEST_F(VideosOfCameras, ACacheThatAnInterruptionLeftInPartIsCompleted) {
  if (!can_cache_photos()) GTEST_SKIP() << "built without zstd or xxhash";
  write_videos(folder(), {10, 10});
  DatasetConfig dataset = dataset_of_little_memory();
  dataset.photo_cache = cache().string();
  load_scene(dataset);
  std::vector<std::filesystem::path> entries;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(cache()))
    if (entry.is_regular_file()) entries.push_back(entry.path());
  for (std::size_t i = 0; i < entries.size(); i += 3) std::filesystem::remove(entries[i]);
  std::filesystem::resize_file(entries[1], 40);
  expect_frames(load_scene(dataset), 10);
  for (const std::filesystem::path& entry : entries) EXPECT_TRUE(std::filesystem::exists(entry));
}

TEST_F(VideosOfCameras, AnotherVideoOfTheSameNameHasItsOwnFrames) {
  if (!can_cache_photos()) GTEST_SKIP() << "built without zstd or xxhash";
  write_videos(folder(), {10, 10});
  DatasetConfig dataset = dataset_of_little_memory();
  dataset.photo_cache = cache().string();
  load_scene(dataset);
  std::filesystem::rename(folder() / "images/cam0.avi", folder() / "images/other.avi");
  std::filesystem::rename(folder() / "images/cam1.avi", folder() / "images/cam0.avi");
  std::filesystem::rename(folder() / "images/other.avi", folder() / "images/cam1.avi");
  const Scene scene = load_scene(dataset);
  EXPECT_EQ(with_photo(scene.train_views[3])->photo.pixels, frame_of(1, 3).pixels);
  EXPECT_EQ(with_photo(scene.train_views[13])->photo.pixels, frame_of(0, 3).pixels);
}

TEST_F(VideosOfCameras, WithoutMemoryAndCacheAreStillRight) {
  write_videos(folder(), {10, 10});
  CapturedLog logged;
  const Scene scene = load_scene(dataset_of_little_memory());
  EXPECT_THAT(logged.text(), HasSubstr("20 of 20 frames of videos fit"));
  expect_frames(scene, 10);
}

TEST_F(VideosOfCameras, MayHaveOneMaskForAllFrames) {
  write_videos(folder(), {3, 3});
  Image8 mask(kWidth, kHeight, 3);
  for (std::size_t i = 0; i < mask.pixels.size() / 2; ++i) mask.pixels[i] = 255;
  write_png(folder() / "masks" / "cam1.avi.png", mask);
  const Scene scene = load_scene(dataset());
  EXPECT_TRUE(scene.train_views[2].mask.empty());
  for (int i = 3; i < 6; ++i) EXPECT_FALSE(scene.train_views[std::size_t(i)].mask.empty());
}

TEST_F(VideosOfCameras, AreMentionedWherePhotosAreMissing) {
  write_videos(folder(), {3, 3});
  EXPECT_THAT(error_of(gs::dataset_at(folder())),
              AllOf(HasSubstr("there is the video cam0.avi"), HasSubstr("dataset.times=frames")));
}

TEST_F(VideosOfCameras, OfDifferentLengthAreRefused) {
  write_videos(folder(), {3, 2});
  EXPECT_THAT(error_of(dataset()),
              AllOf(HasSubstr("cam1.png has 2 frames"), HasSubstr("cam0.png has 3")));
}

TEST_F(VideosOfCameras, ThatAreDamagedOrCutShortAreNamed) {
  const IgnoreForeignLeaks ignore;  // from OpenCV's backends
  write_videos(folder(), {30, 30});
  const std::filesystem::path video = folder() / "images/cam1.avi";
  write_bytes(video, read_bytes(video).substr(0, 15 * (3 * kWidth * kHeight + 8)));
  EXPECT_THAT(error_of(dataset()),
              AllOf(HasSubstr(video.string() + " ends after"), HasSubstr("damaged or cut short")));
  write_bytes(video, std::string(5000, 'x'));
  EXPECT_THAT(error_of(dataset()), AllOf(HasSubstr(video.string()), HasSubstr("damaged")));
}

TEST_F(VideosOfCameras, TwoOfOneCameraAreRefused) {
  write_videos(folder(), {3, 3});
  std::filesystem::copy(folder() / "images/cam0.avi", folder() / "images/cam0.mp4");
  EXPECT_THAT(error_of(dataset()),
              AllOf(HasSubstr("cam0.avi and cam0.mp4"), HasSubstr("leave one there")));
}

TEST_F(VideosOfCameras, AreInTheHashesOfScenes) {
  write_videos(folder(), {3, 3});
  const std::vector<std::string> names = {"cam0/00001.png", "cam0/00002.png", "cam1/00001.png"};
  const std::vector<std::uint64_t> before = photo_hashes(dataset(), names);
  const std::string scene = scene_hash(dataset());
  EXPECT_NE(before[0], 0u);
  EXPECT_EQ(before[0], before[1]);
  EXPECT_NE(before[0], before[2]);
  write_avi(folder() / "images/cam0.avi", {frame_of(5, 5), frame_of(5, 6), frame_of(5, 7)});
  const std::vector<std::uint64_t> after = photo_hashes(dataset(), names);
  EXPECT_NE(after[0], before[0]);
  EXPECT_EQ(after[2], before[2]);
  EXPECT_EQ(scene_hash(dataset()), scene);  // which looks at names and sizes only
  write_avi(folder() / "images/cam0.avi", {frame_of(5, 5)});
  EXPECT_NE(scene_hash(dataset()), scene);
}

TEST_F(FilmsOfCameras, AreRefusedWithTheNameOfThePackage) {
  if (can_read_videos()) GTEST_SKIP() << "built with OpenCV";
  write_videos(folder(), {3, 3});
  EXPECT_THAT(error_of(dataset_at(folder(), PhotoTimes::frames)), HasSubstr("libopencv-dev"));
}

TEST_F(FilmsOfCameras, HasTheTimesOfTheNumbersInItsNames) {
  ColmapModel model = small_model(3);
  model.images[0].name = "take2_0030.png";
  model.images[1].name = "take2_0010.png";
  model.images[2].name = "take2_0050.png";
  write_scene(folder(), model);
  const Scene scene = load_scene(dataset_at(folder(), PhotoTimes::names));
  EXPECT_EQ(scene.time_count, 3u);
  std::vector<float> times;
  for (const View& view : scene.train_views) times.push_back(view.camera.time);
  EXPECT_THAT(times, ElementsAre(0.0f, 0.5f, 1.0f));  // in the order of the names
}

TEST_F(FilmsOfCameras, WithANameWithoutANumberIsRefused) {
  write_scene(folder(), small_model(2));
  EXPECT_THAT(error_of(dataset_at(folder(), PhotoTimes::names)),
              AllOf(HasSubstr("a.png has no number"), HasSubstr("frame_0012.png")));
}

TEST_F(FilmsOfCameras, SeveralImagesOfOneCameraAreRefused) {
  write_films(folder(), {3});
  ColmapModel model = small_model(2);
  model.images[0].name = "cam0/100.png";
  model.images[1].name = "cam0/101.png";
  write_binary_model(folder() / "sparse" / "0", model);
  EXPECT_THAT(error_of(dataset_at(folder(), PhotoTimes::frames)),
              HasSubstr("dataset.times = \"names\""));
}

}  // namespace
}  // namespace gs
