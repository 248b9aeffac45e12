// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/load_scene.h"

#include <gmock/gmock.h>

#include "data_loaders/lenses/undistort.h"
#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/photos.h"
#include "gs_core/error.h"
#include "tests/support/exif_photo.h"
#include "tests/support/load_scene.h"
#include "tests/support/tiny_photos.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

class LoadScene : public SceneTest {};

TEST_F(LoadScene, GivesViewsPointsAndExtent) {
  write(small_model(3));
  const Scene scene = load();
  ASSERT_EQ(scene.train_views.size(), 3u);
  EXPECT_TRUE(scene.test_views.empty());
  const View& view = scene.train_views[2];
  EXPECT_EQ(view.name, "c.png");
  EXPECT_EQ(view.camera.width, 12);
  EXPECT_EQ(view.camera.height, 8);
  EXPECT_EQ(view.camera.fx, 10);
  EXPECT_EQ(view.camera.fy, 11);
  EXPECT_EQ(view.camera.cx, 6.5f);  // off the center, and kept
  EXPECT_EQ(view.camera.cy, 3.5f);
  EXPECT_EQ(view.camera.position(), Vec3f(2, 0, 0));
  EXPECT_EQ(view.photo.pixels, plain_photo(12, 8, 20).pixels);
  ASSERT_EQ(scene.points.size(), 2u);
  EXPECT_EQ(scene.points[0].position, Vec3f(1, 2, 3));
  EXPECT_THAT(scene.points[1].color, ElementsAre(255, 0, 1));
  EXPECT_FLOAT_EQ(scene.extent, 1.1f);  // cameras at x = 0, 1, 2
}

TEST_F(LoadScene, RotationTakesWorldToCamera) {
  ColmapModel model = small_model(1);
  const double h = std::sqrt(0.5);
  model.images[0].cam_from_world_rotation = {h, 0, 0, h};  // 90 degrees about z: x goes to y
  write(model);
  const Camera camera = load().train_views[0].camera;
  const Vec3f turned = multiply(camera.cam_from_world_rotation, Vec3f(1, 0, 0));
  EXPECT_NEAR(turned.x, 0, 1e-6);
  EXPECT_NEAR(turned.y, 1, 1e-6);
}

TEST_F(LoadScene, ExposuresOfExifAreReadWhereAskedFor) {
  ColmapModel model = small_model(2);
  model.images[0].name = "a.jpg";
  write(model);
  write_bytes(image("a.jpg"), exposed_photo(12, 8, {0.25, 2, 16}));
  const DatasetConfig dataset = dataset_at(folder());
  const SceneNeeds needs{true};
  const Scene scene = load_scene(dataset, {}, PhotoLoading::as_they_fit, needs);
  ASSERT_TRUE(scene.train_views[0].exposure_stops);
  EXPECT_NEAR(*scene.train_views[0].exposure_stops, 0, 1e-5);  // log2(0.25 * 16 / 4)
  EXPECT_FALSE(scene.train_views[1].exposure_stops);           // a PNG without EXIF
  EXPECT_FALSE(load_scene(dataset).train_views[0].exposure_stops);
}

TEST_F(LoadScene, ModelIsFoundInAllItsPlaces) {
  for (const std::string place :
       {"sparse/0", "sparse/1", "sparse", "colmap/sparse/0", ".", "elsewhere/2"}) {
    std::filesystem::remove_all(folder());
    write(small_model(2));
    if (place != "sparse/0") {
      std::filesystem::rename(folder() / "sparse/0", folder() / "model");
      std::filesystem::create_directories(folder() / place);
      for (const auto& file : std::filesystem::directory_iterator(folder() / "model"))
        std::filesystem::rename(file, folder() / place / file.path().filename());
    }
    DatasetConfig dataset = dataset_at(folder());
    if (place == "elsewhere/2") dataset.model = place;
    EXPECT_EQ(load_scene(dataset).train_views.size(), 2u) << place;
  }
}

TEST_F(LoadScene, SubModelWithTheMostPhotosIsTakenAndSaid) {
  write(small_model(5));
  write_png(image("unplaced.png"), plain_photo(12, 8, 5));
  write_bytes(image("notes.txt"), "");
  std::filesystem::rename(folder() / "sparse/0", folder() / "sparse/10");
  write_text_model(folder() / "sparse/0", small_model(2));
  write_binary_model(folder() / "sparse/2", small_model(3));
  write_binary_model(folder() / "sparse/11", small_model(5));      // no more than sparse/10
  write_binary_model(folder() / "sparse/backup", small_model(6));  // not of COLMAP's naming
  EXPECT_THAT(log_of(dataset()),
              HasSubstr("sparse/10 holds 5 of 6 photos; sparse/11 holds 5, sparse/2 holds 3, "
                        "sparse/0 holds 2"));
  EXPECT_EQ(load().train_views.size(), 5u);

  DatasetConfig named = dataset();
  named.model = "sparse/2";
  EXPECT_THAT(log_of(named), Not(HasSubstr("holds")));
  EXPECT_EQ(load_scene(named).train_views.size(), 3u);
}

TEST_F(LoadScene, NextToNothingOfThePhotosIsRefusedUnlessNamed) {
  write(small_model(6));
  write_binary_model(folder() / "sparse/0", small_model(2));
  EXPECT_THAT(error(),
              AllOf(HasSubstr("only 2 of the 6 photos"), HasSubstr((folder() / "images").string()),
                    HasSubstr("run COLMAP again"), HasSubstr("dataset.model")));
  DatasetConfig named = dataset();
  named.model = "sparse/0";
  EXPECT_EQ(load_scene(named).train_views.size(), 2u);

  std::filesystem::remove(image("f.png"));  // 2 of 5 is few, and not next to nothing
  EXPECT_EQ(load().train_views.size(), 2u);
}

TEST_F(LoadScene, ViewsAreSortedByNameAndEveryNthIsHeldOut) {
  ColmapModel model = small_model(5);
  const char* names[] = {"b/2.png", "B.png", "a10.png", "a9.png", "b/1.png"};
  for (int i = 0; i < 5; ++i) model.images[i].name = names[i];
  write(model);
  DatasetConfig dataset = dataset_at(folder());
  dataset.eval = true;
  dataset.test_every = 3;
  const Scene scene = load_scene(dataset);
  EXPECT_THAT(names_of(scene.test_views), ElementsAre("B.png", "b/1.png"));
  EXPECT_THAT(names_of(scene.train_views), ElementsAre("a10.png", "a9.png", "b/2.png"));
  EXPECT_EQ(scene.train_views[2].photo.pixels[0],
            0);  // the photo in the sub-folder, the first in the model
  EXPECT_EQ(scene.train_views[0].photo.pixels[0], 20);
}

TEST_F(LoadScene, SplitThatLeavesNothingIsRefused) {
  write(small_model(1));
  DatasetConfig dataset = dataset_at(folder());
  dataset.eval = true;
  EXPECT_THROW(load_scene(dataset), UsageError);
  EXPECT_THAT(error_of(dataset),
              AllOf(HasSubstr("no view is left"), HasSubstr("dataset.test_every")));
  dataset.test_every = 0;
  EXPECT_THAT(error_of(dataset), HasSubstr("test_every is 0"));
  write(small_model(0));
  EXPECT_THAT(error_of(dataset_at(folder())), HasSubstr("no images"));
}

TEST_F(LoadScene, ResolutionDividesOrIsTheWidth) {
  write(small_model(1));  // 12 x 8
  const auto camera_at = [&](int resolution) {
    DatasetConfig dataset = dataset_at(folder());
    dataset.resolution = resolution;
    const View view = load_scene(dataset).train_views[0];
    EXPECT_EQ(view.photo.width, view.camera.width);
    EXPECT_EQ(view.photo.height, view.camera.height);
    return view.camera;
  };
  EXPECT_EQ(camera_at(2).width, 6);
  EXPECT_EQ(camera_at(2).height, 4);
  EXPECT_EQ(camera_at(8).width, 2);  // 1.5, rounded
  EXPECT_EQ(camera_at(8).height, 1);
  EXPECT_FLOAT_EQ(camera_at(8).fx, 10 * 2.0f / 12);  // the true ratio of each axis
  EXPECT_FLOAT_EQ(camera_at(8).fy, 11 * 1.0f / 8);
  EXPECT_FLOAT_EQ(camera_at(8).cx, 6.5f * 2 / 12);
  EXPECT_EQ(camera_at(9).width, 9);
  EXPECT_EQ(camera_at(9).height, 6);
  EXPECT_EQ(camera_at(12).width, 12);
  for (int wrong : {-1, 3, 5, 6, 7, 13}) {
    DatasetConfig dataset = dataset_at(folder());
    dataset.resolution = wrong;
    EXPECT_THROW(load_scene(dataset), UsageError) << wrong;
  }
}

/// The size of the only photo in training, and what is logged meanwhile.
std::pair<PhotoSize, std::string> trained_size(const PhotoSize& photo,
                                               const DatasetConfig& dataset) {
  ColmapModel model = small_model(1);
  ColmapCamera& camera = model.cameras.begin()->second;
  camera.width = photo.width;
  camera.height = photo.height;
  write_scene(dataset.source, model);
  write_png(std::filesystem::path(dataset.source) / "images" / model.images[0].name,
            plain_photo(photo.width, photo.height, 50));
  CapturedLog logged;
  const View view = load_scene(dataset).train_views[0];
  const std::string& log = logged.text();
  EXPECT_EQ(view.photo.width, view.camera.width);
  return {{view.camera.width, view.camera.height}, log};
}

TEST_F(LoadScene, LargePhotosAreReducedUnlessAResolutionIsAskedFor) {
  DatasetConfig dataset = dataset_at(folder());
  const auto size_of = [&](int width, int height) {
    const auto [size, log] = trained_size({width, height}, dataset);
    const bool is_reduced = size.width != width || size.height != height;
    EXPECT_EQ(log.find("are trained at") != log.npos, is_reduced && dataset.resolution == 0) << log;
    return std::pair(size.width, size.height);
  };
  EXPECT_EQ(size_of(1602, 90), std::pair(1600, 90));
  EXPECT_EQ(size_of(100, 3200), std::pair(50, 1600));
  EXPECT_EQ(size_of(1600, 70), std::pair(1600, 70));
  dataset.resolution = 1;
  EXPECT_EQ(size_of(100, 3200), std::pair(100, 3200));
  dataset.resolution = 0;
  EXPECT_THAT(trained_size({3200, 100}, dataset).second,
              HasSubstr("photos of 3200x100 are trained at 1600x50; -r 1 keeps all"));
}

/// A scene with transforms.json and two photos, taken at these times.
void write_timed_scene(const std::filesystem::path& folder, double first, double second) {
  std::string frames;
  for (const auto& [name, time] : {std::pair("a.png", first), std::pair("b.png", second)}) {
    write_png(folder / name, plain_photo(12, 8, 50));
    frames += std::string(frames.empty() ? "" : ", ") + "{\"file_path\": \"" + name +
              "\", \"time\": " + std::to_string(time) +
              ", \"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}";
  }
  write_bytes(folder / "transforms.json", "{\"fl_x\": 10, \"frames\": [" + frames + "]}");
}

TEST_F(LoadScene, ViewsHaveTheTimesOfTheirFrames) {
  write_timed_scene(folder(), 0.25, 0.25);
  EXPECT_EQ(load().time_count, 1u);
  write_timed_scene(folder(), 0.25, 0.75);
  const Scene scene = load();
  EXPECT_EQ(scene.time_count, 2u);
  EXPECT_EQ(scene.train_views[0].camera.time, 0.25f);
  EXPECT_EQ(scene.train_views[1].camera.time, 0.75f);
}

TEST_F(LoadScene, TimesBeyondOneAreScaledToTheScenesDuration) {
  write_timed_scene(folder(), 30, 10);
  const Scene scene = load();
  EXPECT_EQ(scene.train_views[0].camera.time, 1.0f);
  EXPECT_EQ(scene.train_views[1].camera.time, 0.0f);
}

TEST_F(LoadScene, MissingPhotosAreNamedAndCounted) {
  write(small_model(14));
  const auto remove_photos = [&](char first, char last) {
    for (char name = first; name <= last; ++name)
      std::filesystem::remove(folder() / "images" / (std::string(1, name) + ".png"));
  };
  remove_photos('b', 'k');
  EXPECT_THAT(
      error(),
      AllOf(HasSubstr("10 of the model's 14 photos"),
            HasSubstr("b.png, c.png, d.png, e.png, f.png, g.png, h.png, i.png, j.png, k.png;"),
            HasSubstr((folder() / "images").string())));
  remove_photos('l', 'm');
  write_png(image("other.png"), plain_photo(12, 8, 5));
  EXPECT_THAT(error(),
              AllOf(HasSubstr("12 of the model's 14 photos"), HasSubstr("j.png, k.png and 2 more"),
                    Not(HasSubstr("l.png")), HasSubstr("1 photo there is not in the model"),
                    HasSubstr("other.png")));
}

TEST_F(LoadScene, AFewPhotosThatAreMissingOrCutShortCostThemselvesAndKeepTheSplit) {
  write(small_model(10));
  DatasetConfig dataset = dataset_at(folder());
  dataset.eval = true;  // holds out a and i
  std::filesystem::remove(image("c.png"));
  const std::string whole = read_bytes(image("e.png"));
  write_bytes(image("e.png"), whole.substr(0, whole.size() / 2));
  EXPECT_THAT(log_of(dataset), AllOf(HasSubstr("2 of 10 photos are left out"),
                                     HasSubstr("c.png (missing), e.png (cut short)")));
  const Scene scene = load_scene(dataset);
  EXPECT_THAT(names_of(scene.train_views),
              ElementsAre("b.png", "d.png", "f.png", "g.png", "h.png", "j.png"));
  EXPECT_THAT(names_of(scene.test_views), ElementsAre("a.png", "i.png"));
  EXPECT_EQ(scene.train_views[2].photo.pixels[0], 50);  // its own photo
  std::filesystem::remove(image("b.png"));
  EXPECT_THAT(error_of(dataset), HasSubstr("2 of the model's 10 photos are not in"));
}

TEST_F(LoadScene, BackSlashesInNamesAreSlashes) {
  ColmapModel model = small_model(3);
  write(model);
  std::filesystem::create_directories(image("day1"));
  std::filesystem::rename(image("a.png"), image("day1/a.png"));
  model.images[0].name = "day1\\a.png";
  model.images[1].name = "C:\\Users\\me\\images\\b.png";
  write_binary_model(folder() / "sparse/0", model);
  EXPECT_THAT(names_of(load().train_views), ElementsAre("b.png", "c.png", "day1/a.png"));
}

TEST_F(LoadScene, AFileInPlaceOfAFolderGetsTheSentenceThatHelps) {
  for (const auto& [name, help] :
       {std::pair("fox.zip", "unpack it first"), std::pair("a.HEIC", "one photo: name the folder"),
        std::pair("model.ply", "gemsplat view"), std::pair("model.ply", "--from"),
        std::pair("cameras.xml", "one file of a scene"), std::pair("best.toml", "-c"),
        std::pair("notes", "name the folder")}) {
    write_bytes(folder() / name, "something");
    EXPECT_THAT(error_of(dataset_at(folder() / name)), AllOf(HasSubstr(help), HasSubstr(name)));
  }
}

/// A scene whose photos have other names than in the model: (in the model, on disk).
DatasetConfig renamed_scene(const std::filesystem::path& folder,
                            const std::vector<std::pair<const char*, const char*>>& names) {
  ColmapModel model = small_model(int(names.size()));
  for (std::size_t i = 0; i < names.size(); ++i) model.images[i].name = names[i].first;
  write_binary_model(folder / "sparse/0", model);
  for (std::size_t i = 0; i < names.size(); ++i)
    write_png(folder / "images" / names[i].second, plain_photo(12, 8, std::uint8_t(10 * i)));
  return dataset_at(folder);
}

TEST_F(LoadScene, PhotosOfAnotherExtensionOrCaseAreTakenAndCounted) {
  const DatasetConfig dataset = renamed_scene(folder(), {{"a.jpg", "a.png"},
                                                         {"b 1.tif", "b 1.png"},
                                                         {"Left/C.png", "left/c.PNG"},
                                                         {"Left/D.JPG", "left/d.png"},
                                                         {"e.png", "e.png"}});
  write_bytes(image("a.txt"), "a note on a.png");
  write_bytes(image("._a.png"), "what macOS leaves behind");
  EXPECT_THAT(log_of(dataset),
              AllOf(HasSubstr("1 photo is taken for names in the model that differ in upper and "
                              "lower case: left/c.PNG for 'Left/C.png'"),
                    HasSubstr("2 photos are taken for names in the model that differ in extension: "
                              "a.png for 'a.jpg', ..."),
                    HasSubstr("1 photo is taken for names in the model that differ in case and "
                              "extension: left/d.png for 'Left/D.JPG'")));
  const Scene scene = load_scene(dataset);
  EXPECT_THAT(names_of(scene.train_views),  // as the model has them
              ElementsAre("Left/C.png", "Left/D.JPG", "a.jpg", "b 1.tif", "e.png"));
  EXPECT_EQ(scene.train_views[0].photo.pixels[0], 20);
  EXPECT_EQ(scene.train_views[1].photo.pixels[0], 30);
  EXPECT_EQ(scene.train_views[2].photo.pixels[0], 0);
}

TEST_F(LoadScene, PhotoThatCouldBelongToTwoNamesIsTakenForNone) {
  const DatasetConfig two_files =
      renamed_scene(folder() / "1", {{"a.jpg", "a.png"}, {"b.png", "b.png"}});
  write_png(folder() / "1/images/a.tif.png", plain_photo(12, 8, 5));
  std::filesystem::rename(folder() / "1/images/a.tif.png", folder() / "1/images/a.tif");
  EXPECT_THAT(error_of(two_files), HasSubstr("1 of the model's 2 photos"));
  EXPECT_THAT(error_of(renamed_scene(folder() / "2", {{"a.jpg", "a.png"}, {"a.tif", "a.png"}})),
              HasSubstr("2 of the model's 2 photos"));  // one file for two names
  EXPECT_THAT(error_of(renamed_scene(folder() / "3", {{"a.jpg", "a.png"}, {"a.png", "a.png"}})),
              HasSubstr("1 of the model's 2 photos is not in"));  // a file that another name owns
}

TEST_F(LoadScene, PhotosOfOneNameInTwoFoldersAreTwoPhotos) {
  const DatasetConfig dataset =
      renamed_scene(folder(), {{"left/1.png", "left/1.png"}, {"right/1.png", "right/1.png"}});
  const Scene scene = load_scene(dataset);
  EXPECT_THAT(names_of(scene.train_views), ElementsAre("left/1.png", "right/1.png"));
  EXPECT_EQ(scene.train_views[0].photo.pixels[0], 0);
  EXPECT_EQ(scene.train_views[1].photo.pixels[0], 10);
  std::filesystem::rename(image("left/1.png"), image("1.png"));
  EXPECT_THAT(error_of(dataset), HasSubstr("1 of the model's 2 photos"));
}

TEST_F(LoadScene, NamesMayNotLeaveTheImagesFolder) {
  for (const char* name : {"../a.png", "sub/../../a.png", "/tmp/a.png"}) {
    ColmapModel model = small_model(1);
    write(model);
    model.images[0].name = name;
    write_binary_model(folder() / "sparse/0", model);
    EXPECT_THAT(error(), HasSubstr("leads out of the images folder"));
  }
}

TEST_F(LoadScene, SmallerPhotosScaleTheIntrinsics) {
  ColmapModel model = small_model(1);
  model.cameras[7] = {7, CameraModel::pinhole, 1201, 800, {1000, 1100, 650, 350}};
  write_binary_model(folder() / "sparse/0", model);
  write_png(image("a.png"), plain_photo(300, 200, 5));  // a quarter, to a pixel
  const Camera camera = load().train_views[0].camera;
  EXPECT_EQ(camera.width, 300);
  EXPECT_EQ(camera.height, 200);
  EXPECT_FLOAT_EQ(camera.fx, 1000 * 300.0f / 1201);
  EXPECT_FLOAT_EQ(camera.fy, 275);
  EXPECT_FLOAT_EQ(camera.cy, 87.5f);
}

TEST_F(LoadScene, SwappedSizeIsCalledSo) {
  write(small_model(1));
  write_png(image("a.png"), plain_photo(8, 12, 5));
  EXPECT_THAT(error(), AllOf(HasSubstr("8 x 12"), HasSubstr("12 x 8"), HasSubstr("swapped"),
                             HasSubstr("EXIF"), HasSubstr("auto-orient")));
}

TEST_F(LoadScene, OtherShapeIsRefusedWithBothSizes) {
  ColmapModel model = small_model(1);
  model.cameras[7] = {7, CameraModel::pinhole, 120, 80, {100, 100, 60, 40}};
  write(model);
  write_png(image("a.png"), plain_photo(100, 80, 5));
  EXPECT_THAT(error(), AllOf(HasSubstr("100 x 80"), HasSubstr("120 x 80"), Not(HasSubstr("EXIF"))));
}

TEST_F(LoadScene, LensIsUndistorted) {
  ColmapModel model = small_model(2);
  model.cameras[7] = {7, CameraModel::simple_radial, 120, 80, {100, 63, 38, -0.1}};
  write(model);
  const View view = load().train_views[1];
  EXPECT_EQ(view.camera.fx, 100);
  EXPECT_GT(view.camera.width, 120);  // barrel distortion: the corners were pulled in
  EXPECT_FLOAT_EQ(view.camera.cx, 63.0f * view.camera.width / 120);
  EXPECT_EQ(view.photo.width, view.camera.width);
  EXPECT_EQ(view.photo.pixels, plain_photo(view.camera.width, view.camera.height, 10).pixels);
}

TEST_F(LoadScene, ImpossibleLensNamesThePhoto) {
  ColmapModel model = small_model(1);
  model.cameras[7] = {7, CameraModel::pinhole, 12, 8, {0, 9, 6, 4}};
  write(model);
  EXPECT_THAT(error(), AllOf(HasSubstr("a.png"), HasSubstr("PINHOLE")));
}

TEST_F(LoadScene, DamagedPhotoIsNamed) {
  ColmapModel model = small_model(4);
  model.cameras[7] = {7, CameraModel::pinhole, 16, 8, {10, 10, 8, 4}};
  write(model);
  model.images[2].name = "c.jpg";
  write_binary_model(folder() / "sparse/0", model);
  const std::string cut(reinterpret_cast<const char*>(kTurnedJpeg), sizeof(kTurnedJpeg) - 20);
  write_bytes(image("c.jpg"), cut);  // its header is whole
  EXPECT_THAT(error(), HasSubstr("c.jpg"));
}

TEST_F(LoadScene, PointBeyondSinglePrecisionIsRefused) {
  ColmapModel model = small_model(2);
  model.points[1].position.y = -1e60;
  write(model);
  EXPECT_THAT(error(), HasSubstr("point 900000000000"));
}

TEST_F(LoadScene, PoseBeyondSinglePrecisionIsRefused) {
  ColmapModel model = small_model(2);
  model.images[1].cam_from_world_translation.x = 1e60;
  write(model);
  EXPECT_THAT(error(), AllOf(HasSubstr("b.png"), HasSubstr("single precision")));
}

TEST_F(LoadScene, NotASceneListsThePlacesAndTheNearestMatch) {
  std::filesystem::create_directories(folder() / "empty");
  EXPECT_THAT(error_of(dataset_at(folder() / "empty")),
              AllOf(HasSubstr("empty/sparse/0, "), HasSubstr("empty/sparse, "),
                    HasSubstr("dataset.model")));
  EXPECT_THAT(error_of(dataset_at(folder() / "nowhere")), HasSubstr("no such folder"));
  EXPECT_THROW(load_scene(DatasetConfig{}), UsageError);

  const auto scene = folder() / "garden";
  write_scene(scene, small_model(1));
  EXPECT_THAT(error(),
              HasSubstr(scene.string() + " has one"));  // one level down
  EXPECT_THAT(error_of(dataset_at(scene / "images")),
              HasSubstr(scene.string() + " has one"));  // one level up
  EXPECT_THAT(error_of(dataset_at(scene / "sparse/0")),
              HasSubstr("train on " + scene.string()));  // photos two up
  std::filesystem::rename(scene / "sparse/0", scene / "sparse/aligned");
  EXPECT_THAT(error_of(dataset_at(scene)), HasSubstr("--set dataset.model=sparse/aligned"));

  write_binary_model(folder() / "work/dense/0/sparse", small_model(1));
  EXPECT_THAT(error_of(dataset_at(folder() / "work")), HasSubstr("work/dense/0 has one"));
}

TEST_F(LoadScene, ProgressCountsEveryPhotoInOrder) {
  write(small_model(4));
  std::vector<std::size_t> headers, photos;
  load_scene(dataset(), [&](LoadStage stage, std::size_t done, std::size_t total) {
    (stage == LoadStage::headers ? headers : photos).push_back(done);
    EXPECT_EQ(total, 4u);
  });
  EXPECT_THAT(headers, ElementsAre(1, 2, 3, 4));
  EXPECT_THAT(photos, ElementsAre(1, 2, 3, 4));
}

// Two cameras of transforms.json, at the origin and one unit to the right of it, both looking along
// -z of OpenGL.
std::string transforms_of(const std::vector<std::string>& files) {
  std::string frames;
  for (std::size_t i = 0; i < files.size(); ++i)
    frames +=
        (i ? ", " : "") + ("{\"file_path\": \"" + files[i] + "\", \"transform_matrix\": [[1,0,0," +
                           std::to_string(i) + "],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}");
  return "{\"fl_x\": 10, \"fl_y\": 11, \"cx\": 6, \"cy\": 4, \"w\": 12, \"h\": 8, \"frames\": [" +
         frames + "]}";
}

TEST_F(LoadScene, TakesTransformsWhereColmapHasLeftNothing) {
  for (const char* name : {"a.png", "b.png"})
    write_png(folder() / "pictures" / name, plain_photo(12, 8, 50));
  write_bytes(folder() / "transforms.json", transforms_of({"./pictures/b.png", "pictures/a.png"}));
  const Scene scene = load();
  ASSERT_EQ(scene.train_views.size(), 2u);
  EXPECT_THAT(names_of(scene.train_views), ElementsAre("pictures/a.png", "pictures/b.png"));
  EXPECT_EQ(scene.train_views[0].camera.position(), Vec3f(1, 0, 0));
  EXPECT_EQ(scene.train_views[1].camera.position(), Vec3f(0, 0, 0));
  // Backwards in OpenGL is forwards here: points at -z are in front of the camera.
  const Vec3f ahead =
      multiply(scene.train_views[1].camera.cam_from_world_rotation, Vec3f(0, 0, -1));
  EXPECT_FLOAT_EQ(ahead.z, 1);
  EXPECT_TRUE(scene.points.empty());
}

TEST_F(LoadScene, ABlenderSceneSaysItselfWhatIsForTesting) {
  for (const char* name : {"train/a.png", "train/b.png", "test/a.png"})
    write_png(folder() / name, plain_photo(12, 8, 50));
  write_bytes(folder() / "transforms_train.json", transforms_of({"./train/a", "./train/b"}));
  write_bytes(folder() / "transforms_test.json", transforms_of({"./test/a"}));
  DatasetConfig dataset = dataset_at(folder());
  dataset.eval = true;
  const Scene scene = load_scene(dataset);
  EXPECT_THAT(names_of(scene.test_views), ElementsAre("test/a.png"));
  EXPECT_EQ(scene.train_views.size(), 2u);
  dataset.eval = false;
  EXPECT_EQ(load_scene(dataset).train_views.size(), 3u);
}

}  // namespace
}  // namespace gs
