// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/doctor/doctor.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <fstream>
#include <random>

#include "data_loaders/colmap/colmap_write.h"
#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/photos/picture_quality.h"
#include "data_loaders/video/video_frames.h"
#include "tests/support/adaptive.h"
#include "tests/support/avi_writer.h"
#include "tests/support/exif_photo.h"
#include "tests/support/load_scene.h"
#include "tests/support/scenes.h"
#include "tests/support/tiny_photos.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using Level = Finding::Level;

Config config_at(const std::filesystem::path& folder) {
  Config config = adaptive_config();
  config.dataset.source = folder.string();
  return config;
}

class Doctor : public SceneTest {
 protected:
  Diagnosis examined(bool look_at_pictures = true) const {
    return examine(config_at(folder()), look_at_pictures);
  }
};

/// The only finding of this level and topic.
Finding the(const Diagnosis& diagnosis, Level level, const std::string& topic) {
  std::vector<Finding> found;
  std::string all;
  for (const Finding& finding : diagnosis.findings) {
    all += finding.topic + ": " + finding.text + "\n";
    if (finding.level == level && finding.topic == topic) found.push_back(finding);
  }
  EXPECT_EQ(found.size(), 1u) << topic << " in\n" << all;
  return found.empty() ? Finding{} : found.front();
}
std::size_t count(const Diagnosis& diagnosis, Level level) {
  return std::size_t(std::count_if(diagnosis.findings.begin(), diagnosis.findings.end(),
                                   [&](const Finding& finding) { return finding.level == level; }));
}

TEST_F(Doctor, HasNothingAgainstAGoodScene) {
  write(small_model(24));
  const Diagnosis diagnosis = examined(false);
  EXPECT_TRUE(diagnosis.can_train());
  EXPECT_EQ(count(diagnosis, Level::warning), 0u);
  EXPECT_THAT(the(diagnosis, Level::good, "model").text,
              HasSubstr("24 photos placed, 1 camera, 2 points"));
  EXPECT_THAT(the(diagnosis, Level::good, "lenses").text, HasSubstr("PINHOLE 12x8"));
  EXPECT_THAT(the(diagnosis, Level::good, "points").text, HasSubstr("error 0.50 pixels"));
  EXPECT_THAT(the(diagnosis, Level::note, "forecast").text,
              AllOf(HasSubstr("training on the CPU"), Not(HasSubstr("H200"))));
}

TEST_F(Doctor, SaysHowMuchExposuresDifferByExif) {
  ColmapModel model = small_model(3);
  model.images[0].name = "a.jpg";
  model.images[1].name = "b.jpg";
  write(model);
  write_bytes(image("a.jpg"), exposed_photo(12, 8, {0.01, 4, 100}));
  write_bytes(image("b.jpg"), exposed_photo(12, 8, {0.02, 4, 400}));
  EXPECT_THAT(the(examined(), Level::note, "light").text,
              HasSubstr("by EXIF, the exposures of 2 of 3 photos differ by 3.0 stops"));
}

TEST_F(Doctor, NamesTheFramesThatAVideoLacks) {
  if (!can_read_videos()) GTEST_SKIP() << "built without OpenCV";
  ColmapModel model = small_model(2);
  model.images[0].name = "cam0.png";
  model.images[1].name = "cam1.png";
  write_binary_model(folder() / "sparse" / "0", model);
  const std::vector<Image8> frames(30, random_photo(12, 8, 1));
  write_avi(image("cam0.avi"), frames);
  write_avi(image("cam1.avi"), frames);
  const std::filesystem::path cut = image("cam1.avi");
  write_bytes(cut, read_bytes(cut).substr(0, 15 * (3 * 12 * 8 + 8)));
  Config config = config_at(folder());
  config.dataset.times = PhotoTimes::frames;
  const Finding damaged = the(examine(config, true), Level::fatal, "photos");
  EXPECT_THAT(damaged.text, HasSubstr("damaged"));
  EXPECT_GE(damaged.names.size(), 15u);
  EXPECT_LE(damaged.names.size(), 20u);
  EXPECT_THAT(damaged.names, testing::Each(HasSubstr("cam1/000")));
}

TEST_F(Doctor, ForecastOfMemoryKeepsToTheBudgetOfPhotos) {
  write(small_model(24));
  Config config = config_at(folder());
  EXPECT_THAT(the(examine(config, false), Level::note, "forecast").text,
              Not(HasSubstr("just before their turn")));
  config.dataset.photo_ram_gib = 1e-6f;  // of 24 photos of 288 bytes
  EXPECT_THAT(the(examine(config, false), Level::note, "forecast").text,
              HasSubstr("just before their turn"));
}

TEST_F(Doctor, StopsWhereNoViewCanShowAnyPoint) {
  ColmapModel model = small_model(24);
  for (ColmapPoint& point : model.points) point.position.z *= -1;  // behind all cameras
  write(model);
  const Diagnosis diagnosis = examined(false);
  EXPECT_FALSE(diagnosis.can_train());
  EXPECT_THAT(the(diagnosis, Level::fatal, "sight").text,
              AllOf(HasSubstr("none of 24 views see any of the 2 points"), HasSubstr("behind")));
}

TEST_F(Doctor, NamesThePlaneThatHidesEverything) {
  write(small_model(24));
  Config config = config_at(folder());
  config.render.near_plane = 50;
  EXPECT_THAT(the(examine(config, false), Level::fatal, "sight").text,
              HasSubstr("--set render.near_plane=0.04"));
  config.render.near_plane = 0.03f;
  EXPECT_TRUE(examine(config, false).can_train());
}

TEST_F(Doctor, WarnsWhereMostViewsSeeNothing) {
  ColmapModel model = small_model(24);
  for (int i = 0; i < 200; ++i)
    model.points.push_back({std::uint64_t(100 + i), {0.01 * i, 900.0, 3.0}, {1, 2, 3}});
  model.points.erase(model.points.begin(), model.points.begin() + 2);
  write(model);
  const Diagnosis diagnosis = examined(false);
  EXPECT_TRUE(diagnosis.can_train());
  EXPECT_THAT(the(diagnosis, Level::warning, "sight").text, HasSubstr("beside"));
}

TEST_F(Doctor, ExaminesPhotosBeforeColmapAndStopsOnlyWhereTrainWould) {
  Config config = adaptive_config();
  config.dataset.source = (folder() / "photos").string();
  config.reconstruct.colmap = "/bin/true";  // a program that is there
  for (const char* name : {"a.png", "day/b.png"})
    write_png(folder() / "photos" / name, random_photo(40, 32, 1));
  EXPECT_FALSE(examine(config, true).can_train());  // two photos
  for (const char* name : {"c.png", "d.png", "e.png", "f.png"})
    write_png(folder() / "photos" / name, random_photo(40, 32, 1));
  write_png(folder() / "photos/dim.png", plain_photo(40, 32, 3));
  write_bytes(folder() / "photos/turned.jpg",
              std::string(reinterpret_cast<const char*>(kTurnedJpeg), sizeof kTurnedJpeg));
  const Diagnosis diagnosis = examine(config, true);
  EXPECT_TRUE(diagnosis.can_train());
  EXPECT_THAT(the(diagnosis, Level::good, "scene").text, HasSubstr("gemsplat reconstruct"));
  EXPECT_THAT(the(diagnosis, Level::warning, "photos").text, HasSubstr("8 photos"));
  EXPECT_THAT(the(diagnosis, Level::note, "orientation").names, ElementsAre("turned.jpg"));
  EXPECT_THAT(diagnosis.findings.back().names, testing::Contains("dim.png"));
  config.reconstruct.colmap = "/no/colmap";
  EXPECT_THAT(the(examine(config, false), Level::fatal, "scene").text,
              HasSubstr("apt install colmap"));
  write_bytes(folder() / "photos/walk.psx", "<document/>");
  EXPECT_THAT(the(examine(config, false), Level::fatal, "scene").text, HasSubstr("Metashape"));
  EXPECT_FALSE(examine(config_at(folder() / "nowhere"), true).can_train());
}

TEST_F(Doctor, NamesAllMissingAndUnreadablePhotos) {
  write(small_model(24));
  for (const char* name : {"b.png", "d.png", "e.png"}) std::filesystem::remove(image(name));
  write_bytes(image("c.png"), "no picture");
  write_png(image("surplus.png"), plain_photo(12, 8, 1));
  const Diagnosis diagnosis = examined();
  EXPECT_FALSE(diagnosis.can_train());
  EXPECT_THAT(the(diagnosis, Level::warning, "photos").names,
              ElementsAre("b.png", "d.png", "e.png"));
  EXPECT_THAT(the(diagnosis, Level::fatal, "photos").names, ElementsAre("c.png"));
  EXPECT_THAT(the(diagnosis, Level::note, "photos").names, ElementsAre("surplus.png"));
}

TEST_F(Doctor, StopsForLostPhotosOnlyWhereTrainingDoes) {
  write(small_model(24));
  const std::string whole = read_bytes(image("b.png"));
  write_bytes(image("b.png"), whole.substr(0, whole.size() / 2));
  const Diagnosis few = examined();
  EXPECT_TRUE(few.can_train());
  EXPECT_THAT(the(few, Level::warning, "photos").names, ElementsAre("b.png"));
  for (const char* name : {"c.png", "d.png", "e.png", "f.png", "g.png"})
    std::filesystem::remove(image(name));
  EXPECT_FALSE(examined().can_train());
}

TEST_F(Doctor, TellsPhotosOnTheirSideFromOtherPhotos) {
  write(small_model(24));
  write_png(image("b.png"), plain_photo(8, 12, 1));
  write_png(image("c.png"), plain_photo(10, 10, 1));
  write_png(image("d.png"), plain_photo(24, 16, 1));
  const Diagnosis diagnosis = examined();
  EXPECT_THAT(the(diagnosis, Level::fatal, "orientation").names, ElementsAre("b.png"));
  EXPECT_THAT(the(diagnosis, Level::fatal, "photos").names, ElementsAre("c.png"));
  EXPECT_THAT(the(diagnosis, Level::note, "photos").text, HasSubstr("1 photo has another size"));
}

TEST_F(Doctor, FindsExifOrientations) {
  ColmapModel model = small_model(24);
  model.cameras[7] = {7, CameraModel::pinhole, 16, 8, {10, 11, 6.5, 3.5}};
  model.images[0].name = "a.jpg";
  write(model);
  write_bytes(image("a.jpg"),
              std::string(reinterpret_cast<const char*>(kTurnedJpeg), sizeof kTurnedJpeg));
  if (read_photo_orientation(image("a.jpg")) == 1) GTEST_SKIP() << "this build reads no EXIF";
  const Diagnosis diagnosis = examined(false);
  EXPECT_TRUE(diagnosis.can_train());
  EXPECT_THAT(the(diagnosis, Level::note, "orientation").names, ElementsAre("a.jpg"));
}

TEST_F(Doctor, WarnsOfStrayCamerasAndFewPhotos) {
  ColmapModel model = small_model(12);
  model.images[3].cam_from_world_translation = {0, 0, 5000};
  write(model);
  const Diagnosis diagnosis = examined(false);
  EXPECT_TRUE(diagnosis.can_train());
  EXPECT_THAT(the(diagnosis, Level::warning, "cameras").names, ElementsAre("d.png"));
  EXPECT_THAT(the(diagnosis, Level::warning, "model").text, HasSubstr("12 photos are few"));
}

TEST_F(Doctor, WarnsOfPointsAndPlaces) {
  ColmapModel model = small_model(24);
  model.points.clear();
  for (ColmapImage& image : model.images) image.cam_from_world_translation.y = 4e6;
  write(model);
  const Diagnosis diagnosis = examined(false);
  EXPECT_TRUE(diagnosis.can_train());
  EXPECT_THAT(the(diagnosis, Level::warning, "points").text,
              AllOf(HasSubstr("no points"), HasSubstr("gemsplat reconstruct")));
  EXPECT_THAT(the(diagnosis, Level::note, "place").text, HasSubstr("0 -4000000 0 is subtracted"));
}

TEST_F(Doctor, AdvisesToRefinePosesWhereReprojectionErrorsAreLarge) {
  for (const double error : {0.5, 3.0}) {
    ColmapModel model = small_model(24);
    for (ColmapPoint& point : model.points) point.error = error;
    write(model);
    write_colmap_model(folder() / "sparse/0", model);  // with its errors
    const Diagnosis diagnosis = examined(false);
    const bool is_advised =
        std::any_of(diagnosis.findings.begin(), diagnosis.findings.end(), [](const Finding& found) {
          return found.text.find("--set poses.refine=true") != std::string::npos;
        });
    EXPECT_EQ(is_advised, error > 2) << error;
  }
}

TEST_F(Doctor, RefusesWhatLoadingRefuses) {
  ColmapModel model = small_model(24);
  model.cameras[7].params[0] = -1;
  write(model);
  EXPECT_FALSE(examined(false).can_train());

  write(small_model(24));
  Config config = config_at(folder());
  config.dataset.resolution = 3;
  EXPECT_FALSE(examine(config, false).can_train());
}

TEST_F(Doctor, CountsLargePhotosAtTheSizeThatTheyTrainAt) {
  ColmapModel model = small_model(24);
  model.cameras[7].width = 3200;
  model.cameras[7].height = 20;
  write(model);
  for (const ColmapImage& image : model.images)
    write_png(folder() / "images" / image.name, plain_photo(3200, 20, 90));
  Config config = config_at(folder());
  const Diagnosis reduced = examine(config, false);
  EXPECT_EQ(the(reduced, Level::note, "pictures").text,
            "photos of 3200x20 are trained at 1600x10; -r 1 keeps all of their pixels");
  config.dataset.resolution = 2;
  const Diagnosis half = examine(config, false);
  EXPECT_EQ(the(reduced, Level::note, "forecast").text, the(half, Level::note, "forecast").text);
  config.dataset.resolution = 1;
  EXPECT_NE(the(examine(config, false), Level::note, "forecast").text,
            the(half, Level::note, "forecast").text);
}

TEST_F(Doctor, NamesAPhotoOfTheCameraThatItRefuses) {
  ColmapModel model = small_model(24);
  model.cameras[7] = {7, CameraModel::pinhole, 12, 8, {0, 9, 6, 4}};
  write(model);
  const std::string text = the(examined(false), Level::fatal, "lenses").text;
  EXPECT_THAT(text, AllOf(HasSubstr("'a.png'"), Not(HasSubstr("of camera"))));
}

TEST_F(Doctor, SaysWhatBecomesOfPanoramas) {
  ColmapModel model = small_model(24);
  model.cameras[7] = {7, CameraModel::equirectangular, 64, 32, {64, 32}};
  write(model);
  const Diagnosis diagnosis = examined(true);
  EXPECT_TRUE(diagnosis.can_train());
  EXPECT_THAT(the(diagnosis, Level::good, "panoramas").text, HasSubstr("24 panoramas train as"));
  EXPECT_EQ(the(diagnosis, Level::good, "lenses").text, "EQUIRECTANGULAR 64x32");
}

TEST_F(Doctor, PassesOverCamerasWithoutPhotos) {
  ColmapModel model = small_model(24);
  model.cameras[8] = {8, CameraModel::pinhole, 12, 8, {0, 9, 6, 4}};
  write(model);
  EXPECT_TRUE(examined(false).can_train());
}

TEST_F(Doctor, OfAFolderAboveASceneNamesTheSceneAndNothingElse) {
  write_scene(folder() / "garden", small_model(3));
  const Diagnosis diagnosis = examined(false);
  ASSERT_EQ(diagnosis.findings.size(), 1u);  // and no note to reconstruct photos that have a model
  EXPECT_THAT(diagnosis.findings[0].text, HasSubstr("garden has one: train on that"));
}

/// A file of a Blender scene with one frame.
std::string blender_file(const std::string& photo, const std::string& more = "") {
  return "{\"camera_angle_x\": 0.7, \"frames\": [{\"file_path\": \"" + photo + "\"" + more +
         ", \"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]}";
}

TEST_F(Doctor, DoesNotBlameColmapForPhotosOfABlenderScene) {
  for (const char* part : {"train", "test", "val"}) {
    const std::string name = std::string(part) + "/r_0";
    write_png(folder() / (name + ".png"), plain_photo(12, 12, 9));
    write_bytes(folder() / ("transforms_" + std::string(part) + ".json"), blender_file(name));
  }
  const Finding unused = the(examined(false), Level::note, "photos");
  EXPECT_THAT(unused.names, ElementsAre("val/r_0.png"));
  EXPECT_THAT(unused.text, AllOf(HasSubstr("1 picture in the folder is not used"),
                                 HasSubstr("transforms_train.json"), Not(HasSubstr("COLMAP"))));
}

TEST_F(Doctor, WarnsOfASceneThatMoves) {
  for (const char* part : {"train", "test"}) {
    const std::string name = std::string(part) + "/r_0";
    write_png(folder() / (name + ".png"), plain_photo(12, 12, 9));
    write_bytes(folder() / ("transforms_" + std::string(part) + ".json"),
                blender_file(name, std::string(", \"time\": ") + (part[1] == 'r' ? "0" : "1")));
  }
  std::vector<std::string> warnings;
  for (const Finding& finding : examined(false).findings)
    if (finding.topic == "model" && finding.level == Level::warning)
      warnings.push_back(finding.text);
  EXPECT_THAT(warnings, testing::Contains(HasSubstr("the scene moves")));
}

TEST_F(Doctor, CountsPhotosWithARollingShutter) {
  write_png(folder() / "r_0.png", plain_photo(12, 12, 9));
  const auto pose = [](const char* when, double x) {
    return fmt::format(", \"transform_matrix_{}\": [[1,0,0,{}],[0,1,0,0],[0,0,1,4],[0,0,0,1]]",
                       when, x);
  };
  write_bytes(folder() / "transforms.json",
              blender_file("r_0", pose("start", 0) + pose("end", 0.1)));
  std::vector<std::string> said;
  for (const Finding& finding : examined(false).findings)
    if (finding.topic == "lenses") said.push_back(finding.text);
  EXPECT_THAT(said, testing::Contains(HasSubstr("1 photo is seen row by row")));
}

/// Noise, which is sharp, blurred by `smoothing` means over neighbors, times `gain`.
Image8 noise(int smoothing, double gain, unsigned seed) {
  std::mt19937 engine(seed);
  Image8 image(64, 48, 3);
  for (std::uint8_t& value : image.pixels) value = std::uint8_t(64 + engine() % 128);
  for (int round = 0; round < smoothing; ++round)
    for (int y = 0; y < image.height; ++y)
      for (int x = 0; x + 1 < image.width; ++x)
        for (int c = 0; c < 3; ++c)
          image.at(x, y, c) = std::uint8_t((image.at(x, y, c) + image.at(x + 1, y, c)) / 2);
  for (std::uint8_t& value : image.pixels) value = std::uint8_t(std::min(255.0, value * gain));
  return image;
}

TEST(PictureQuality, TellsTheBlurredAndTheDarkFromTheRest) {
  std::vector<PictureQuality> qualities;
  for (unsigned i = 0; i < 12; ++i)
    qualities.push_back(quality_of(noise(i == 4 ? 6 : 0, i == 9 ? 0.3 : 1.0 + 0.01 * i, i)));
  const QualityOutliers outliers = outliers_of(qualities);
  EXPECT_THAT(outliers.odd_exposure, ElementsAre(9));
  EXPECT_THAT(outliers.blurred, testing::Contains(4));
  EXPECT_THAT(outliers_of({qualities[4], qualities[0], qualities[9]}).blurred, IsEmpty());
  EXPECT_THAT(outliers_of(std::vector<PictureQuality>(9, qualities[0])).blurred, IsEmpty());
}

TEST_F(Doctor, NamesOddPictures) {
  ColmapModel model = small_model(24);
  model.cameras[7] = {7, CameraModel::pinhole, 64, 48, {60, 60, 32, 24}};
  write(model);
  for (unsigned i = 0; i < 24; ++i)
    write_png(folder() / "images" / model.images[i].name,
              noise(i == 2 ? 6 : 0, i == 5 ? 0.3 : 1, i));
  std::size_t last = 0, all = 0;
  Config config = config_at(folder());
  const Diagnosis diagnosis = examine(config, true, [&](std::size_t done, std::size_t total) {
    EXPECT_EQ(done, ++last);
    all = total;
  });
  EXPECT_EQ(last, all);
  EXPECT_EQ(all, 24u);
  std::vector<std::vector<std::string>> named;
  for (const Finding& finding : diagnosis.findings)
    if (finding.topic == "pictures" && finding.level == Level::warning)
      named.push_back(finding.names);
  ASSERT_EQ(named.size(), 2u);
  EXPECT_THAT(named[0], testing::Contains("c.png"));
  EXPECT_THAT(named[1], ElementsAre("f.png"));
}

}  // namespace
}  // namespace gs
