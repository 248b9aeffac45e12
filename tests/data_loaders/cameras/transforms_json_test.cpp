// SPDX-License-Identifier: Apache-2.0
// transforms.json of nerfstudio and instant-ngp, and the three files of Blender's scenes.
#include "data_loaders/transforms/transforms_json.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "data_loaders/photos/encode/encode_png.h"
#include "gs_core/error.h"
#include "gs_core/math/random.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/text/json.h"
#include "gs_model/formats/ply/ply.h"
#include "tests/support/captured_log.h"
#include "tests/support/colmap_writer.h"
#include "tests/support/error_of.h"
#include "tests/support/folder_test.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

constexpr double kTolerance = 1e-12;  // some roundings of double

SortedJson identity() { return SortedJson::parse("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"); }

SortedJson frame(const std::string& file_path) {
  return {{"file_path", file_path}, {"transform_matrix", identity()}};
}

/// Two frames that share a pinhole of 12 x 8 pixels; `change` replaces or adds keys at the top, and
/// `frame_change` in the second frame; null removes one.
SortedJson small_file(const char* change = "{}", const char* frame_change = "{}") {
  SortedJson file = {{"fl_x", 10.5}, {"fl_y", 11.5}, {"cx", 6.5}, {"cy", 3.5}, {"w", 12}, {"h", 8}};
  file["frames"] = SortedJson::array({frame("images/a.png"), frame("images/b.png")});
  file.merge_patch(SortedJson::parse(change));
  if (file.contains("frames") && file["frames"].size() > 1)
    file["frames"][1].merge_patch(SortedJson::parse(frame_change));
  return file;
}

class Transforms : public FolderTest {
 protected:
  void write(const SortedJson& file, const char* name = "transforms.json") const {
    write_bytes(folder() / name, file.dump());
  }
  TransformsScene read(const SortedJson& file) const {
    write(file);
    return read_transforms(folder());
  }
  /// The message of the Error that reading the folder throws; any other exception fails the test.
  std::string error() const {
    return error_of([&] { read_transforms(folder()); });
  }
  std::string error_reading(const SortedJson& file) const {
    write(file);
    return error();
  }
  /// The camera of the first image.
  ColmapCamera camera_of(const SortedJson& file) const {
    const ColmapModel model = read(file).model;
    return model.cameras.at(model.images.at(0).camera_id);
  }
};

std::vector<std::string> names_of(const ColmapModel& model) {
  std::vector<std::string> names;
  for (const ColmapImage& image : model.images) names.push_back(image.name);
  return names;
}

/// The position of a world point in the camera of an image.
Vec3d in_camera(const ColmapImage& image, const Vec3d& point) {
  return multiply(rotation_matrix(image.cam_from_world_rotation), point) +
         image.cam_from_world_translation;
}

void expect_near(const Vec3d& a, const Vec3d& b, double tolerance = kTolerance) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

TEST_F(Transforms, FolderIsKnownByEitherFile) {
  EXPECT_FALSE(has_transforms(folder()));
  EXPECT_FALSE(has_transforms(folder() / "none"));
  write(small_file(), "transforms_test.json");
  EXPECT_FALSE(has_transforms(folder()));
  write(small_file(), "transforms_train.json");
  EXPECT_TRUE(has_transforms(folder()));
  std::filesystem::remove(folder() / "transforms_train.json");
  write(small_file());
  EXPECT_TRUE(has_transforms(folder()));
}

// --- Time

TEST_F(Transforms, TimesOfFramesAreCounted) {
  EXPECT_EQ(read(small_file()).time_count, 0u);
  EXPECT_EQ(read(small_file("{}", R"({"time": 0.5})")).time_count, 1u);
  SortedJson moving = small_file("{}", R"({"time": 0.5})");
  moving["frames"][0]["time"] = 0;
  EXPECT_EQ(read(moving).time_count, 2u);
  moving["frames"][0]["time"] = "noon";  // a note of another program
  EXPECT_EQ(read(moving).time_count, 1u);
}

TEST_F(Transforms, TimesOfBlendersFilesAreCountedTogether) {
  SortedJson train = small_file("{}", R"({"time": 0.5})"),
             test = small_file("{}", R"({"time": 1.0})");
  test["frames"].erase(0);
  test["frames"][0]["file_path"] = "test/r_0";
  write(train, "transforms_train.json");
  write(test, "transforms_test.json");
  EXPECT_EQ(read_transforms(folder()).time_count, 2u);
}

// --- Poses

TEST_F(Transforms, CameraAtTheOriginLooksAlongMinusZWithYUp) {
  const ColmapImage image = read(small_file()).model.images[0];
  expect_near(in_camera(image, {0.0, 0.0, -5.0}), {0.0, 0.0, 5.0});   // in front
  expect_near(in_camera(image, {1.0, 0.0, -5.0}), {1.0, 0.0, 5.0});   // to the right
  expect_near(in_camera(image, {0.0, 1.0, -5.0}), {0.0, -1.0, 5.0});  // above: y points down
}

TEST_F(Transforms, CameraOnTheXAxisLooksBackAtTheOrigin) {
  SortedJson file = small_file();  // world z is up, as in Blender: right = y, up = z, backwards = x
  file["frames"][0]["transform_matrix"] =
      SortedJson::parse("[[0,0,1,4],[1,0,0,0],[0,1,0,0],[0,0,0,1]]");
  const ColmapImage image = read(file).model.images[0];
  expect_near(in_camera(image, {4.0, 0.0, 0.0}), {0.0, 0.0, 0.0});
  expect_near(in_camera(image, {0.0, 0.0, 0.0}), {0.0, 0.0, 4.0});
  expect_near(in_camera(image, {0.0, 0.5, 0.25}), {0.5, -0.25, 4.0});
}

/// Random rotations cover all four branches of the conversion to a quaternion, because each
/// component is the largest in some of them.
TEST_F(Transforms, PoseIsTheInverseOfTheMatrixForAnyRotation) {
  SortedJson file = small_file();
  int largest_count[4] = {};
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const Vec4f r = Random{seed, RandomStream::test}.normal4(0);
    const Quat<double> q{r.x, r.y, r.z, r.w};
    const Mat3<double> R = rotation_matrix(q);  // world_from_cam, OpenGL's axes
    const Vec3d center{0.5 + double(seed), -2.0, 3.25};
    file["frames"][0]["transform_matrix"] = {{R.row0.x, R.row0.y, R.row0.z, center.x},
                                             {R.row1.x, R.row1.y, R.row1.z, center.y},
                                             {R.row2.x, R.row2.y, R.row2.z, center.z}};
    const ColmapImage image = read(file).model.images[0];
    const Vec3d in_opengl{0.3, -0.7, -2.0};
    expect_near(in_camera(image, multiply(R, in_opengl) + center), {0.3, 0.7, 2.0});
    const Quat<double>& p = image.cam_from_world_rotation;
    EXPECT_NEAR(squared_norm(p), 1, kTolerance);
    const double parts[] = {std::abs(p.w), std::abs(p.x), std::abs(p.y), std::abs(p.z)};
    ++largest_count[std::max_element(parts, parts + 4) - parts];
  }
  for (const int count : largest_count) EXPECT_GT(count, 0);
}

TEST_F(Transforms, RotationsWithFewDigitsAreTakenAndTheCenterStays) {
  SortedJson file = small_file();
  file["frames"][0]["transform_matrix"] =
      SortedJson::parse("[[0.866,-0.5,0,10],[0.5,0.866,0,20],[0,0,1,30],[0,0,0,1]]");
  const ColmapImage image = read(file).model.images[0];
  EXPECT_NEAR(squared_norm(image.cam_from_world_rotation), 1, kTolerance);
  expect_near(in_camera(image, {10.0, 20.0, 30.0}), {0.0, 0.0, 0.0});
  const double c = std::sqrt(0.75);
  expect_near(in_camera(image, {10 + c, 20.5, 30.0}), {1.0, 0.0, 0.0}, 1e-3);  // its three digits
}

// --- Intrinsics

TEST_F(Transforms, FocalLengthsInPixelsAreTakenAsTheyAre) {
  const ColmapCamera camera = camera_of(small_file());
  EXPECT_EQ(camera.model, CameraModel::pinhole);
  EXPECT_EQ(camera.width, 12);
  EXPECT_EQ(camera.height, 8);
  EXPECT_THAT(camera.params, ElementsAre(10.5, 11.5, 6.5, 3.5));
}

TEST_F(Transforms, OneFocalLengthStandsForBothAndTheCenterIsThePictures) {
  const char* only_x = R"({"fl_y": null, "cx": null, "cy": null, "w": 12.0})";
  EXPECT_THAT(camera_of(small_file(only_x)).params, ElementsAre(10.5, 10.5, 6, 4));
  const char* only_y = R"({"fl_x": null, "cx": null, "cy": null})";
  EXPECT_THAT(camera_of(small_file(only_y)).params, ElementsAre(11.5, 11.5, 6, 4));
}

TEST_F(Transforms, AnglesAreThoseAcrossTheWholePicture) {
  const double right = std::acos(-1) / 2;  // 90 degrees: the focal length is half the side
  SortedJson file = small_file(R"({"fl_x": null, "fl_y": null})");
  file["camera_angle_x"] = right;
  const std::vector<double> square = camera_of(file).params;
  EXPECT_NEAR(square[0], 6, kTolerance);
  EXPECT_NEAR(square[1], 6, kTolerance);
  file["camera_angle_y"] = right;
  const std::vector<double> both = camera_of(file).params;
  EXPECT_NEAR(both[0], 6, kTolerance);
  EXPECT_NEAR(both[1], 4, kTolerance);
  file["fl_x"] = 7;  // in pixels before the angle, as instant-ngp writes both
  EXPECT_EQ(camera_of(file).params[0], 7);
}

TEST_F(Transforms, EveryCameraModelIsTaken) {
  struct Case {
    const char* change;
    CameraModel model;
    std::vector<double> params;
  };
  const char* zeros = R"({"k1": 0, "k2": 0.0, "p1": 0, "p2": 0, "k3": 0, "k4": 0})";
  const std::vector<double> plain = {10.5, 11.5, 6.5, 3.5};
  const auto with = [&](std::vector<double> lens) {
    lens.insert(lens.begin(), plain.begin(), plain.end());
    return lens;
  };
  const Case cases[] = {
      {zeros, CameraModel::pinhole, plain},
      {R"({"camera_model": "PINHOLE"})", CameraModel::pinhole, plain},
      {R"({"camera_model": "SIMPLE_PINHOLE", "k1": 0})", CameraModel::pinhole, plain},
      {R"({"camera_model": "OPENCV", "k1": 0.1, "k2": 0.2, "p1": 0.3, "p2": 0.4})",
       CameraModel::opencv, with({0.1, 0.2, 0.3, 0.4})},
      {R"({"p2": -0.4})", CameraModel::opencv, with({0, 0, 0, -0.4})},
      {R"({"k1": 0.1, "p1": 0.3, "k3": 0.5})", CameraModel::full_opencv,
       with({0.1, 0, 0.3, 0, 0.5, 0, 0, 0})},
      {R"({"camera_model": "OPENCV_FISHEYE", "k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4, "p1": 0})",
       CameraModel::opencv_fisheye, with({0.1, 0.2, 0.3, 0.4})},
      {R"({"camera_model": "OPENCV_FISHEYE"})", CameraModel::opencv_fisheye, with({0, 0, 0, 0})},
      {R"({"is_fisheye": true, "k1": 0.1})", CameraModel::opencv_fisheye, with({0.1, 0, 0, 0})},
      {R"({"is_fisheye": false, "k1": 0.1})", CameraModel::opencv, with({0.1, 0, 0, 0})},
      {R"({"camera_model": "EQUIRECTANGULAR", "fl_x": null, "fl_y": null})",
       CameraModel::equirectangular,
       {12, 8}},
  };
  for (const Case& c : cases) {
    const ColmapCamera camera = camera_of(small_file(c.change));
    EXPECT_EQ(camera.model, c.model) << c.change;
    EXPECT_EQ(camera.params, c.params) << c.change;
    EXPECT_EQ(int(camera.params.size()), camera_model_info(camera.model).param_count) << c.change;
  }
}

TEST_F(Transforms, FramesWithEqualIntrinsicsShareACamera) {
  const ColmapModel same = read(small_file("{}", R"({"fl_x": 10.5, "w": 12})")).model;
  EXPECT_EQ(same.cameras.size(), 1u);
  EXPECT_EQ(same.images[0].camera_id, 1u);
  EXPECT_EQ(same.images[1].camera_id, 1u);
  EXPECT_EQ(same.images[0].id, 1u);
  EXPECT_EQ(same.images[1].id, 2u);
}

TEST_F(Transforms, AFramesOwnIntrinsicsGoBeforeTheTops) {
  const ColmapModel model = read(small_file("{}", R"({"fl_x": 20, "h": 9, "k1": 0.1})")).model;
  ASSERT_EQ(model.cameras.size(), 2u);
  EXPECT_EQ(model.cameras.at(1).id, 1u);
  EXPECT_THAT(model.cameras.at(1).params, ElementsAre(10.5, 11.5, 6.5, 3.5));
  const ColmapCamera& own = model.cameras.at(model.images[1].camera_id);
  EXPECT_EQ(own.id, 2u);
  EXPECT_EQ(own.height, 9);
  EXPECT_EQ(own.model, CameraModel::opencv);
  EXPECT_THAT(own.params, ElementsAre(20, 11.5, 6.5, 3.5, 0.1, 0, 0, 0));
}

TEST_F(Transforms, AFramesOwnAngleGoesBeforeTheTopsFocalLength) {
  SortedJson file = small_file();
  file["frames"][1]["camera_angle_x"] = std::acos(-1) / 2;
  const ColmapModel model = read(file).model;
  EXPECT_NEAR(model.cameras.at(model.images[1].camera_id).params[0], 6, kTolerance);
  EXPECT_EQ(model.cameras.at(model.images[0].camera_id).params[0], 10.5);
}

// --- Names

TEST_F(Transforms, NamesAreRelativeToTheFolderWithSlashes) {
  SortedJson file = small_file();
  file["frames"] = {frame("./images/a.png"), frame("images\\b c.png"), frame("images/../d.jpg"),
                    frame(".//e.png")};
  EXPECT_THAT(names_of(read(file).model),
              ElementsAre("images/a.png", "images/b c.png", "d.jpg", "e.png"));
}

TEST_F(Transforms, AnAbsentExtensionIsThatOfTheFirstFileThatExists) {
  SortedJson file = small_file();
  file["frames"] = {frame("./a"), frame("./b"), frame("./c"), frame("./d"), frame("./shot.001")};
  for (const char* name : {"a.jpeg", "a.jpg", "a.png", "b.jpeg", "b.jpg", "c.jpeg", "shot.001.jpg"})
    write_bytes(folder() / name, "");
  std::filesystem::create_directory(folder() / "b");
  EXPECT_THAT(names_of(read(file).model),
              ElementsAre("a.png", "b.jpg", "c.jpeg", "d", "shot.001.jpg"));
}

// --- Blender's files

/// A file as Blender writes it for the NeRF synthetic scenes, with photos of 20 x 10 pixels.
void write_blender_file(const std::filesystem::path& folder, const std::string& split, int count) {
  SortedJson file = {{"camera_angle_x", std::acos(-1) / 2}, {"frames", SortedJson::array()}};
  for (int i = 0; i < count; ++i) {
    const std::string name = split + "/r_" + std::to_string(i);
    file["frames"].push_back(frame("./" + name));
    file["frames"][i]["rotation"] = 0.0314;
    write_png(folder / (name + ".png"), plain_photo(20, 10, 0));
  }
  write_bytes(folder / ("transforms_" + split + ".json"), file.dump());
}

TEST_F(Transforms, BlendersTestFileIsForTestingAndItsValFileForNothing) {
  for (const char* split : {"train", "val", "test"}) {
    std::filesystem::create_directories(folder() / split);
    write_blender_file(folder(), split, 2);
  }
  const TransformsScene scene = read_transforms(folder());
  EXPECT_TRUE(scene.has_split);
  EXPECT_THAT(names_of(scene.model),
              ElementsAre("train/r_0.png", "train/r_1.png", "test/r_0.png", "test/r_1.png"));
  EXPECT_THAT(scene.test_names, ElementsAre("test/r_0.png", "test/r_1.png"));
  EXPECT_EQ(scene.model.folder, folder());
  ASSERT_EQ(scene.model.cameras.size(), 1u);
  const ColmapCamera& camera = scene.model.cameras.at(1);
  EXPECT_EQ(camera.width, 20);  // from the photos
  EXPECT_EQ(camera.height, 10);
  EXPECT_NEAR(camera.params[0], 10, kTolerance);
  EXPECT_NEAR(camera.params[1], 10, kTolerance);
  EXPECT_EQ(camera.params[2], 10);
  EXPECT_EQ(camera.params[3], 5);
}

TEST_F(Transforms, BlendersValFileIsForTestingWhereThereIsNoTestFile) {
  for (const char* split : {"train", "val"}) {
    std::filesystem::create_directories(folder() / split);
    write_blender_file(folder(), split, 1);
  }
  const TransformsScene scene = read_transforms(folder());
  EXPECT_TRUE(scene.has_split);
  EXPECT_THAT(scene.test_names, ElementsAre("val/r_0.png"));
  EXPECT_EQ(scene.model.images.size(), 2u);
}

TEST_F(Transforms, BlendersTrainFileAloneSplitsNothing) {
  std::filesystem::create_directories(folder() / "train");
  write_blender_file(folder(), "train", 2);
  const TransformsScene scene = read_transforms(folder());
  EXPECT_FALSE(scene.has_split);
  EXPECT_THAT(scene.test_names, IsEmpty());
  EXPECT_EQ(scene.model.images.size(), 2u);
}

TEST_F(Transforms, FaultsInBlendersTestFileNameThatFile) {
  write(small_file(), "transforms_train.json");
  write(small_file(), "transforms_test.json");
  EXPECT_THAT(error(), AllOf(HasSubstr((folder() / "transforms_test.json").string()),
                             HasSubstr("frame 0"), HasSubstr("'images/a.png'")));
}

TEST_F(Transforms, OneFileGoesBeforeBlendersThree) {
  write(small_file(), "transforms_test.json");
  write_bytes(folder() / "transforms_train.json", "broken");
  const TransformsScene scene = read(small_file());
  EXPECT_EQ(scene.model.images.size(), 2u);
  EXPECT_FALSE(scene.has_split);
}

// --- nerfstudio's lists

struct SplitCase {
  const char* lists;
  std::vector<std::string> images, test_names;
};

TEST_F(Transforms, ListsOfFilenamesSplit) {
  const SplitCase cases[] = {
      {R"({"train_filenames": ["a.png"], "test_filenames": ["./d.png", "b.png"],
           "val_filenames": ["c.png"]})",
       {"a.png", "b.png", "d.png"},
       {"b.png", "d.png"}},
      {R"({"train_filenames": ["a.png"], "val_filenames": ["c.png"]})",
       {"a.png", "c.png"},
       {"c.png"}},
      {R"({"train_filenames": ["a.png"], "test_filenames": [], "val_filenames": ["c.png"]})",
       {"a.png", "c.png"},
       {"c.png"}},
      {R"({"test_filenames": ["a.png"], "val_filenames": ["c.png"]})",
       {"a.png", "b.png", "d.png"},
       {"a.png"}},
      {R"({"train_filenames": ["a.png", "b.png"]})", {"a.png", "b.png"}, {}},
  };
  for (const SplitCase& c : cases) {
    SortedJson file = small_file(c.lists);
    file["frames"] = {frame("a.png"), frame("b.png"), frame("c.png"), frame("d.png")};
    const TransformsScene scene = read(file);
    EXPECT_TRUE(scene.has_split) << c.lists;
    EXPECT_EQ(names_of(scene.model), c.images) << c.lists;
    EXPECT_EQ(scene.test_names, c.test_names) << c.lists;
  }
  EXPECT_FALSE(read(small_file()).has_split);
}

TEST_F(Transforms, APhotoInBothListsIsForTestingWithAWarning) {
  CapturedLog logged;
  const TransformsScene scene = read(small_file(R"({
      "train_filenames": ["images/a.png", "images/b.png"], "test_filenames": ["images/b.png"]})"));
  EXPECT_THAT(logged.text(), AllOf(HasSubstr("1 photo is listed both for training and for testing"),
                                   HasSubstr("transforms.json")));
  EXPECT_THAT(scene.test_names, ElementsAre("images/b.png"));
  EXPECT_EQ(scene.model.images.size(), 2u);
}

// --- Rolling shutters

TEST_F(Transforms, PosesOfTheFirstAndTheLastRowAreAPoseBetweenThemAndAMotion) {
  const double angle = 0.3, c = std::cos(angle), s = std::sin(angle);  // a turn about the y axis
  const SortedJson end = {{c, 0, s, 0.4}, {0, 1, 0, 0.2}, {-s, 0, c, -0.6}, {0, 0, 0, 1}};
  SortedJson file = small_file();
  SortedJson& frame = file["frames"][1];
  frame["transform_matrix_start"] = frame["transform_matrix"];
  frame["transform_matrix_end"] = end;
  frame.erase("transform_matrix");
  const ColmapModel model = read(file).model;
  EXPECT_FALSE(model.images[0].motion.is_any());
  const ColmapImage& image = model.images[1];
  const Mat3<double> W = rotation_matrix(image.cam_from_world_rotation);
  expect_near(-multiply_transposed(W, image.cam_from_world_translation), {0.2, 0.1, -0.3});
  // The world's x axis seen by a camera with y down and z forward, turned by half of the angle.
  expect_near(multiply(W, Vec3d(1, 0, 0)), {std::cos(angle / 2), 0, -std::sin(angle / 2)});
  expect_near(multiply_transposed(W, image.motion.shift), {0.4, 0.2, -0.6});
  // The first pose turned by the whole motion is the last one.
  const Mat3<double> E = rotation_minus_identity(image.motion.turn);
  const Vec3d first = multiply(rotation_matrix(Quat<double>{0, 1, 0, 0}), Vec3d(1, 2, 3));
  const Mat3<double> last{{c, 0, -s}, {0, -1, 0}, {-s, 0, -c}};
  expect_near(first + multiply(E, first), multiply(last, Vec3d(1, 2, 3)));
  for (const char* shutter : {"[0, 0, 1, 0]", "[0, 0, 1]"}) {
    file["rolling_shutter"] = SortedJson::parse(shutter);
    EXPECT_TRUE(read(file).model.images[1].motion.turn == image.motion.turn);
  }
  for (const char* shutter : {"[0, 1, 0, 0]", "[0, 0, 1, 0.5]", "[0, 0, 0, 0]", "1", "[0, 0]"}) {
    file["rolling_shutter"] = SortedJson::parse(shutter);
    EXPECT_THAT(error_reading(file),
                AllOf(HasSubstr("frame 1"), HasSubstr("as rolling_shutter"),
                      HasSubstr("[0, 0, 1, 0]"), HasSubstr("transform_matrix")));
  }
  frame["transform_matrix_end"] = frame["transform_matrix_start"];  // it stands still
  EXPECT_FALSE(read(file).model.images[1].motion.is_any());
}

// --- Points

TEST_F(Transforms, PointsComeFromThePlyInTheCamerasWorld) {
  write_point_ply(folder() / "sparse_pc.ply",
                  {{{1, 2, 3}, {4, 5, 255}}, {{-1, 0.5, 0}, {0, 0, 9}}});
  const ColmapModel model = read(small_file(R"({"ply_file_path": "./sparse_pc.ply",
      "applied_transform": [[0, 1, 0, 7], [1, 0, 0, 8], [0, 0, -1, 9]]})"))
                                .model;
  ASSERT_EQ(model.points.size(), 2u);
  EXPECT_EQ(model.points[0].id, 1u);
  EXPECT_EQ(model.points[0].position, Vec3d(1.0, 2.0, 3.0));
  EXPECT_THAT(model.points[0].color, ElementsAre(4, 5, 255));
  EXPECT_EQ(model.points[1].id, 2u);
  EXPECT_EQ(model.points[1].position, Vec3d(-1.0, 0.5, 0.0));
  EXPECT_THAT(model.points[1].color, ElementsAre(0, 0, 9));
  expect_near(in_camera(model.images[0], {0.0, 0.0, 0.0}), {0.0, 0.0, 0.0});  // not moved either
}

TEST_F(Transforms, ColorsMayBeRealNumbersOrAbsent) {
  const std::string head =
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\n"
      "property double y\nproperty double z\n";
  const SortedJson file = small_file(R"({"ply_file_path": "p.ply"})");
  write_bytes(folder() / "p.ply", head +
                                      "property float red\nproperty float green\nproperty float "
                                      "blue\nend_header\n1 2 3 0 0.2 1\n4 5 6 nan -1 7\n");
  ColmapModel model = read(file).model;
  EXPECT_THAT(model.points.at(0).color, ElementsAre(0, 51, 255));
  EXPECT_THAT(model.points.at(1).color, ElementsAre(0, 0, 255));
  write_bytes(folder() / "p.ply", head + "end_header\n1 2 3\n4 5 6\n");
  model = read(file).model;
  EXPECT_THAT(model.points.at(1).color, ElementsAre(128, 128, 128));
  EXPECT_EQ(model.points[1].position, Vec3d(4.0, 5.0, 6.0));
}

TEST_F(Transforms, PointsThatAreNotFiniteAreLeftOutAndCounted) {
  write_point_ply(folder() / "p.ply", {{{1, NAN, 3}, {1, 1, 1}}, {{4, 5, 6}, {2, 2, 2}}});
  CapturedLog logged;
  const ColmapModel model = read(small_file(R"({"ply_file_path": "p.ply"})")).model;
  EXPECT_THAT(logged.text(), AllOf(HasSubstr("1 of 2 points"), HasSubstr("left out")));
  ASSERT_EQ(model.points.size(), 1u);
  EXPECT_EQ(model.points[0].id, 1u);
  EXPECT_THAT(model.points[0].color, ElementsAre(2, 2, 2));
}

TEST_F(Transforms, AnUnreadablePlyIsAWarning) {
  const SortedJson file = small_file(R"({"ply_file_path": "p.ply"})");
  for (const char* bytes : {"", "no ply",
                            "ply\nformat ascii 1.0\nelement vertex 1\n"
                            "property float x\nend_header\n1\n"}) {
    if (*bytes) write_bytes(folder() / "p.ply", bytes);
    CapturedLog logged;
    const ColmapModel model = read(file).model;
    EXPECT_THAT(logged.text(),
                AllOf(HasSubstr((folder() / "p.ply").string()), HasSubstr("without points")));
    EXPECT_EQ(model.images.size(), 2u);
    EXPECT_THAT(model.points, IsEmpty());
  }
}

// --- Broken files

TEST_F(Transforms, FaultsNameFileFrameKeyAndRemedy) {
  struct Fault {
    const char *change, *frame_change;  // at the top and in the second frame
    std::vector<const char*> words;
  };
  const char* none = "{}";
  const std::vector<const char*> unknown_model = {
      "frame 0 ('images/a.png')", "RADIAL", "camera_model", "does not know", "OPENCV_FISHEYE"};
  const Fault faults[] = {
      // frames
      {R"({"frames": null})", none, {"no list \"frames\"", "name a file"}},
      {R"({"frames": {}})", none, {"no list \"frames\""}},
      {R"({"frames": []})", none, {"no list \"frames\""}},
      {R"({"frames": [7]})", none, {"frame 0 is not an object", "correct"}},
      // file_path
      {none, R"({"file_path": null})", {"frame 1 lacks file_path", "correct"}},
      {R"({"file_path": "c.png"})", R"({"file_path": null})", {"frame 1 lacks file_path"}},
      {none, R"({"file_path": 7})", {"frame 1 has a value of type number as file_path"}},
      {none, R"({"file_path": ""})", {"frame 1", "file_path", "empty"}},
      {none, R"({"file_path": "/etc/a.png"})", {"('/etc/a.png')", "absolute", "copy the photos"}},
      {none, R"({"file_path": "C:\\a.png"})", {"frame 1", "absolute"}},
      {none, R"({"file_path": "../a.png"})", {"frame 1", "leads out", "copy the photos"}},
      {none, R"({"file_path": "a/../../a.png"})", {"frame 1", "leads out"}},
      {none, R"({"file_path": "..\\a.png"})", {"frame 1", "leads out"}},
      {none, R"({"file_path": "images/"})", {"frame 1", "a folder"}},
      {none, R"({"file_path": "."})", {"frame 1", "a folder"}},
      {none, R"({"file_path": "a.png\u0000b"})", {"frame 1 ('a.png\\x00b')", "file_path"}},
      {none,
       R"({"file_path": "./images/a.png"})",
       {"frame 1", "file_path", "'images/a.png'", "an earlier frame", "leave one out"}},
      // transform_matrix
      {none, R"({"transform_matrix": null})", {"frame 1 ('images/b.png') lacks transform_matrix"}},
      {none, R"({"transform_matrix": 3})", {"frame 1", "transform_matrix", "4 rows of 4"}},
      {none, R"({"transform_matrix": [[1,0,0,0],[0,1,0,0]]})", {"4 rows of 4 numbers"}},
      {none, R"({"transform_matrix": [[1,0,0],[0,1,0],[0,0,1]]})", {"4 rows of 4 numbers"}},
      {none, R"({"transform_matrix": [[1,0,0,0],[0,1,0,0],7,[0,0,0,1]]})", {"4 rows of 4 numbers"}},
      {none,
       R"({"transform_matrix": [[1,0,0,"0"],[0,1,0,0],[0,0,1,0]]})",
       {"frame 1", "a value of type string as an entry of transform_matrix"}},
      {none, R"({"transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,null]]})", {"type null"}},
      {none,
       R"({"transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,2]]})",
       {"frame 1", "last row is not 0 0 0 1"}},
      {none,
       R"({"transform_matrix": [[2,0,0,0],[0,2,0,0],[0,0,2,0],[0,0,0,1]]})",
       {"frame 1 ('images/b.png')", "transform_matrix", "scales", "2, 2 and 2", "write it again"}},
      {none, R"({"transform_matrix": [[0,0,0,0],[0,0,0,0],[0,0,0,0],[0,0,0,1]]})", {"scales"}},
      {none, R"({"transform_matrix": [[1e300,0,0,0],[0,1,0,0],[0,0,1,0]]})", {"scales"}},
      {none,
       R"({"transform_matrix": [[1,0.6,0,0],[0,0.8,0,0],[0,0,1,0],[0,0,0,1]]})",
       {"frame 1", "shears", "right angles"}},
      {none,
       R"({"transform_matrix": [[-1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]})",
       {"frame 1", "mirrors", "left-handed"}},
      {none,
       R"({"transform_matrix": [[0.8,-0.6,0,1.7e308],[0.6,0.8,0,1.7e308],[0,0,1,0],[0,0,0,1]]})",
       {"frame 1", "translation", "not finite"}},
      // intrinsics
      {R"({"fl_x": null, "fl_y": null})", none, {"frame 0", "lacks fl_x, or camera_angle_x"}},
      {R"({"fl_x": 0})", none, {"frame 0", "0 as fl_x", "above 0"}},
      {none, R"({"fl_y": -3})", {"frame 1", "-3 as fl_y", "above 0"}},
      {none, R"({"fl_x": "ten"})", {"frame 1", "a value of type string as fl_x, not a number"}},
      {none, R"({"fl_x": true})", {"type boolean as fl_x"}},
      {none, R"({"camera_angle_x": 0})", {"frame 1", "0 as camera_angle_x", "below 3.1416"}},
      {none, R"({"camera_angle_x": 4})", {"4 as camera_angle_x", "below 3.1416"}},
      {none, R"({"camera_angle_y": 1e-320})", {"camera_angle_y", "too small"}},
      {none, R"({"cx": []})", {"frame 1", "type array as cx"}},
      {none, R"({"w": 0})", {"frame 1", "0 as w", "from 1 to 65520"}},
      {none, R"({"h": -8})", {"frame 1", "-8 as h", "from 1 to 65520"}},
      {none, R"({"w": 65521})", {"65521 as w"}},
      {none, R"({"w": 1e300})", {"1e+300 as w"}},
      {none, R"({"h": 8.5})", {"8.5 as h", "whole number"}},
      {none, R"({"h": "8"})", {"type string as h"}},
      {R"({"w": null})", none, {"frame 0", "has h without w"}},
      {R"({"h": null})", none, {"frame 0", "has w without h"}},
      {R"({"w": null, "h": null})",
       none,
       {"frame 0", "lacks w and h", "images/a.png", "no such file"}},
      // lenses
      {R"({"camera_model": 4})", none, {"frame 0", "type number as camera_model"}},
      {R"({"camera_model": "RADIAL"})", none, unknown_model},
      {none, R"({"k1": "x"})", {"frame 1", "type string as k1"}},
      {none, R"({"k4": 0.5})", {"frame 1", "0.5 as k4", "OPENCV", "undistort"}},
      {none, R"({"k3": 0.1, "k6": 0.5})", {"0.5 as k6"}},
      {R"({"camera_model": "PINHOLE", "p1": 0.1})", none, {"0.1 as p1", "PINHOLE"}},
      {R"({"camera_model": "OPENCV_FISHEYE", "p2": 0.1})", none, {"0.1 as p2", "OPENCV_FISHEYE"}},
      // lists and points
      {R"({"test_filenames": "a.png"})", none, {"test_filenames is not a list"}},
      {R"({"train_filenames": ["images/a.png", "images/c.png"]})",
       none,
       {"entry 1 of train_filenames", "'images/c.png'", "any frame", "correct"}},
      {R"({"val_filenames": [7]})", none, {"entry 0 of val_filenames"}},
      {R"({"test_filenames": ["images/a.png", "images/b.png"]})", none, {"no frame to train on"}},
      {R"({"train_filenames": []})", none, {"train_filenames", "no frame to train on"}},
      {none,
       R"({"transform_matrix_start": 7, "transform_matrix_end": 7})",
       {"frame 1", "transform_matrix_start", "4 rows"}},
      {none,
       R"({"transform_matrix_start": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]],
           "transform_matrix_end": [[-1,0,0,0],[0,-1,0,0],[0,0,1,0],[0,0,0,1]]})",
       {"frame 1", "more than a radian", "correct"}},
      {R"({"ply_file_path": 7})", none, {"ply_file_path", "leave the key out"}},
      {R"({"ply_file_path": "../p.ply"})", none, {"ply_file_path", "copy the PLY"}},
  };
  for (const Fault& fault : faults) {
    const std::string message = error_reading(small_file(fault.change, fault.frame_change));
    EXPECT_THAT(message, StartsWith("cannot read " + (folder() / "transforms.json").string()))
        << fault.change << fault.frame_change;
    for (const char* word : fault.words)
      EXPECT_THAT(message, HasSubstr(word)) << fault.change << fault.frame_change;
  }
  EXPECT_NO_THROW(read(small_file()));  // without the faults it is read
}

TEST_F(Transforms, WhatIsNoJsonIsAnErrorThatNamesTheByte) {
  const std::string text = small_file().dump();
  for (std::size_t length = 0; length < text.size(); ++length) {
    write_bytes(folder() / "transforms.json", text.substr(0, length));
    ASSERT_THAT(error(), AllOf(StartsWith("cannot read " + folder().string()),
                               HasSubstr("not JSON from byte"), HasSubstr("write it again")));
  }
}

TEST_F(Transforms, NumbersThatAreNotFiniteAreErrors) {
  for (const char* number : {"NaN", "Infinity", "-Infinity", "1e999", "-1e999"}) {
    std::string text = small_file().dump();
    text.replace(text.find("10.5"), 4, number);
    write_bytes(folder() / "transforms.json", text);
    EXPECT_THAT(error(), AllOf(HasSubstr("transforms.json"),
                               testing::AnyOf(HasSubstr("NaN or Infinity"),
                                              HasSubstr("number that is not finite"))))
        << number;
  }
}

TEST_F(Transforms, OtherKindsOfJsonAreErrors) {
  for (const char* text : {"[]", "7", "null", "\"frames\"", "{}", "[{\"frames\": []}]"}) {
    write_bytes(folder() / "transforms.json", text);
    EXPECT_THAT(error(), HasSubstr("no list \"frames\"")) << text;
  }
}

TEST_F(Transforms, DeepNestingIsRefusedBeforeItIsParsed) {
  const std::size_t depth = 300'000;  // far more than frames on an 8 MiB stack
  const std::string nest = std::string(depth, '[') + std::string(depth, ']');
  const std::string text = small_file().dump();
  write_bytes(folder() / "transforms.json", "{\"notes\":" + nest + "," + text.substr(1));
  EXPECT_THAT(error(), HasSubstr("deeper than 64 levels"));
  write_bytes(folder() / "transforms.json", nest.substr(0, depth));
  EXPECT_THAT(error(), HasSubstr("deeper than 64 levels"));
}

TEST_F(Transforms, HugeFilesAreRefusedUnread) {
  write(small_file());
  std::filesystem::resize_file(folder() / "transforms.json", std::uintmax_t(1) << 40);
  EXPECT_THAT(error(), AllOf(HasSubstr("more than 134217728 bytes"), HasSubstr("too many")));
}

TEST_F(Transforms, FolderWithoutFilesSaysWhatItNeeds) {
  EXPECT_THAT(error(), AllOf(HasSubstr(folder().string()), HasSubstr("transforms.json"),
                             HasSubstr("transforms_train.json")));
}

}  // namespace
}  // namespace gs
