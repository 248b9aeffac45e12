// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/colmap/colmap_model.h"

#include <gmock/gmock.h>

#include <cmath>
#include <limits>

#include "gs_core/error.h"
#include "tests/support/captured_log.h"
#include "tests/support/colmap_writer.h"
#include "tests/support/error_of.h"
#include "tests/support/folder_test.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

ColmapModel rich_model() {
  ColmapModel model = small_model(3);
  model.cameras[2] = {
      2, CameraModel::opencv, 640, 480, {500, 501, 320.25, 240.5, 0.1, -0.02, 1e-3, -2e-3}};
  model.images[1].name = "left camera/photo 01.JPG";
  model.images[1].camera_id = 2;
  model.images[2].cam_from_world_rotation = {0.5, -0.5, 0.5, 0.5};
  return model;
}

/// The message of the Error that reading `folder` throws; any other exception fails the test.
std::string error_of(const std::filesystem::path& folder) {
  return gs::error_of([&] { read_colmap_model(folder); });
}

void expect_same(const ColmapModel& a, const ColmapModel& b) {
  ASSERT_EQ(a.cameras.size(), b.cameras.size());
  for (const auto& [id, camera] : a.cameras) {
    ASSERT_TRUE(b.cameras.count(id));
    const ColmapCamera& other = b.cameras.at(id);
    EXPECT_EQ(camera.model, other.model);
    EXPECT_EQ(camera.width, other.width);
    EXPECT_EQ(camera.height, other.height);
    EXPECT_EQ(camera.params, other.params);
  }
  ASSERT_EQ(a.images.size(), b.images.size());
  for (std::size_t i = 0; i < a.images.size(); ++i) {
    const Quat<double>&q = a.images[i].cam_from_world_rotation,
          &p = b.images[i].cam_from_world_rotation;
    EXPECT_EQ(a.images[i].id, b.images[i].id);
    EXPECT_EQ(a.images[i].name, b.images[i].name);
    EXPECT_EQ(a.images[i].camera_id, b.images[i].camera_id);
    EXPECT_EQ(a.images[i].cam_from_world_translation, b.images[i].cam_from_world_translation);
    EXPECT_THAT((std::vector{q.w, q.x, q.y, q.z}), testing::ElementsAre(p.w, p.x, p.y, p.z));
  }
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    EXPECT_EQ(a.points[i].id, b.points[i].id);
    EXPECT_EQ(a.points[i].position, b.points[i].position);
    EXPECT_EQ(a.points[i].color, b.points[i].color);
  }
}

class ColmapFiles : public FolderTest {};

TEST_F(ColmapFiles, BinaryAndTextGiveWhatWasWritten) {
  const ColmapModel model = rich_model();
  write_binary_model(path("bin"), model);
  write_text_model(path("txt"), model);
  expect_same(read_colmap_model(path("bin")), model);
  expect_same(read_colmap_model(path("txt")), model);
}

TEST_F(ColmapFiles, BinaryIsPreferredWhereBothExist) {
  write_binary_model(folder(), small_model(2));
  write_text_model(folder(), small_model(5));
  EXPECT_EQ(read_colmap_model(folder()).images.size(), 2u);
}

TEST_F(ColmapFiles, PointsComeByIdAndMayBeAbsent) {
  ColmapModel model = small_model(1);
  std::swap(model.points[0], model.points[1]);
  write_binary_model(folder(), model);
  EXPECT_EQ(read_colmap_model(folder()).points[0].id, 5u);
  std::filesystem::remove(path("points3D.bin"));
  EXPECT_TRUE(read_colmap_model(folder()).points.empty());
}

TEST_F(ColmapFiles, EveryCameraModelIsReadInBothEncodings) {
  ColmapModel model;
  for (int id = 0; id < kCameraModelCount; ++id) {
    const CameraModel kind = CameraModel(id);
    model.cameras[id] = {std::uint32_t(id), kind, 10, 10,
                         std::vector<double>(camera_model_info(kind).param_count, 0.5 + id)};
  }
  write_binary_model(path("bin"), model);
  write_text_model(path("txt"), model);
  expect_same(read_colmap_model(path("bin")), model);
  expect_same(read_colmap_model(path("txt")), model);
}

TEST_F(ColmapFiles, TruncationAtEveryByteIsAnErrorThatNamesFileAndRemedy) {
  write_binary_model(folder(), rich_model());
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    const std::string whole = read_bytes(path(name));
    for (std::size_t size = 0; size < whole.size(); ++size) {
      write_bytes(path(name), whole.substr(0, size));
      ASSERT_THAT(error_of(folder()), AllOf(HasSubstr(name), HasSubstr(folder().string()),
                                            HasSubstr("byte"), HasSubstr("dataset.model")))
          << size;
    }
    write_bytes(path(name), whole + "x");
    EXPECT_THAT(error_of(folder()), HasSubstr("1 bytes follow"));
    write_bytes(path(name), whole);
  }
  EXPECT_NO_THROW(read_colmap_model(folder()));
}

TEST_F(ColmapFiles, HugeCountsAreRefusedBeforeMemoryIsAskedFor) {
  for (std::uint64_t count : {std::uint64_t(1) << 40, ~std::uint64_t(0)})
    for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
      write_binary_model(folder(), small_model(2));
      std::string bytes = read_bytes(path(name));
      std::memcpy(bytes.data(), &count, sizeof(count));
      write_bytes(path(name), bytes);
      EXPECT_THAT(error_of(folder()), HasSubstr("promises " + std::to_string(count)));
    }
}

TEST_F(ColmapFiles, HugeInnerCountsAreRefused) {
  const std::uint64_t huge = ~std::uint64_t(0) / 24 + 2;  // times 24 bytes: wraps round to 24
  for (const char* name : {"images.bin", "points3D.bin"}) {
    write_binary_model(folder(), small_model(1));
    std::string bytes = read_bytes(path(name));
    // The count of the one image, or of the first point, whose record ends here.
    const std::size_t at =
        std::string(name) == "images.bin" ? bytes.size() - 8 : 8 + 8 + 24 + 3 + 8;
    std::memcpy(bytes.data() + at, &huge, sizeof(huge));
    write_bytes(path(name), bytes);
    EXPECT_THAT(error_of(folder()), HasSubstr("promises"));
  }
}

TEST_F(ColmapFiles, UnknownCameraModelIsNamed) {
  ColmapModel model = small_model(1);
  write_text_model(folder(), model);
  write_bytes(path("cameras.txt"), "\n1 SUPER_LENS 10 10 5 5 5\n");
  EXPECT_THAT(error_of(folder()), AllOf(HasSubstr("SUPER_LENS"), HasSubstr("line 2")));
  write_binary_model(folder(), model);
  std::string bytes = read_bytes(path("cameras.bin"));
  bytes[12] = 99;
  write_bytes(path("cameras.bin"), bytes);
  EXPECT_THAT(error_of(folder()), HasSubstr("unknown camera model 99"));
}

/// Each fault in both encodings, and a part of the message.
TEST_F(ColmapFiles, FaultsAreNamed) {
  struct Fault {
    std::function<void(ColmapModel&)> apply;
    const char* complaint;
  };
  const Fault faults[] = {
      {[](ColmapModel& m) { m.images[1].camera_id = 3; }, "names camera 3"},
      {[](ColmapModel& m) { m.images[1].id = 1; }, "image id 1 occurs twice"},
      {[](ColmapModel& m) { m.images[1].name = "a.png"; }, "image name 'a.png' occurs twice"},
      {[](ColmapModel& m) {
         m.images[1].cam_from_world_rotation = {0, 0, 0, 0};
       },
       "zero quaternion"},
      {[](ColmapModel& m) { m.images[1].cam_from_world_rotation.y = kNaN; }, "not finite"},
      {[](ColmapModel& m) { m.images[1].cam_from_world_translation.z = INFINITY; }, "not finite"},
      {[](ColmapModel& m) { m.cameras[7].params[2] = INFINITY; }, "not a finite number"},
      {[](ColmapModel& m) { m.cameras[7].width = 0; }, "picture size 0 x 8"},
      {[](ColmapModel& m) { m.cameras[7].height = 0; }, "picture size 12 x 0"},
      {[](ColmapModel& m) { m.images[1].name = ""; }, "no name"},
  };
  for (const Fault& fault : faults) {
    ColmapModel model = small_model(3);
    fault.apply(model);
    write_binary_model(path("bin"), model);
    write_text_model(path("txt"), model);
    EXPECT_THAT(error_of(path("bin")), HasSubstr(fault.complaint));
    EXPECT_THAT(error_of(path("txt")), HasSubstr(fault.complaint));
  }
}

TEST_F(ColmapFiles, PointsWithoutAFinitePositionAreLeftOutAndCounted) {
  ColmapModel model = small_model(1);
  model.points.push_back({6, {kNaN, 0.0, 0.0}, {1, 2, 3}});
  model.points.push_back({7, {0.0, -INFINITY, 0.0}, {1, 2, 3}});
  write_binary_model(path("bin"), model);
  write_text_model(path("txt"), model);
  write_bytes(path("txt/points3D.txt"),
              "5 1 2 3 10 20 30 0.5\n6 -nan(ind) 0 0 1 2 3 nan\n7 0 -inf nan 1 2 3 0.5\n"
              "8 nan nan nan 1 2 3 0\n900000000000 -1 0.5 4 255 0 1 -nan(ind)\n");
  for (const auto& [name, count] : {std::pair{"bin", "2 of 4 points"}, {"txt", "3 of 5 points"}}) {
    CapturedLog logged;
    const ColmapModel read = read_colmap_model(path(name));
    EXPECT_THAT(logged.text(),
                AllOf(HasSubstr(count), HasSubstr("points3D"), HasSubstr("left out")));
    expect_same(read, small_model(1));
  }
}

TEST_F(ColmapFiles, ImagesAreCountedWithoutReadingThem) {
  write_binary_model(path("bin"), rich_model());
  write_text_model(path("txt"), rich_model());
  EXPECT_EQ(count_colmap_images(path("bin")), 3u);
  EXPECT_EQ(count_colmap_images(path("txt")), 3u);
  write_bytes(path("txt/images.txt"),  // without POINTS2D lines
              "# c\n1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 0 0 0 1 b c.png\n");
  EXPECT_EQ(count_colmap_images(path("txt")), 2u);
}

TEST_F(ColmapFiles, QuaternionsAreMadeUnitLength) {
  ColmapModel model = small_model(1);
  model.images[0].cam_from_world_rotation = {0, 3, 0, 4};
  write_binary_model(folder(), model);
  const Quat<double> q = read_colmap_model(folder()).images[0].cam_from_world_rotation;
  EXPECT_NEAR(q.x, 0.6, 1e-15);
  EXPECT_NEAR(q.z, 0.8, 1e-15);
}

TEST_F(ColmapFiles, MissingPointLinesCarriageReturnsTabsAndNoLastLineFeedAreTaken) {
  write_bytes(path("cameras.txt"), "# c\r\n\r\n1\tPINHOLE 12 8 10 10 6 4\r\n");
  write_bytes(path("images.txt"),
              "# two comments\r\n# here\r\n"
              "1 1 0 0 0 0 0 0 1 sub folder/a b.png\r\n"  // no POINTS2D line
              "2 1 0 0 0 0 0 0 1 123.png\r\n"
              "1 2 -1 3 4 -1 5 6 -1 7 8 12\r\n"
              "3 1 0 0 0 0 0 0 1 c.png\r\n"
              "\r\n"
              "\r\n"
              "4 1 0 0 0 0 0 0 1 d.png");
  const ColmapModel model = read_colmap_model(folder());
  ASSERT_EQ(model.images.size(), 4u);
  EXPECT_EQ(model.images[0].name, "sub folder/a b.png");
  EXPECT_EQ(model.images[1].name, "123.png");
  EXPECT_EQ(model.images[2].name, "c.png");
  EXPECT_EQ(model.images[3].name, "d.png");
}

TEST_F(ColmapFiles, NamesThatAreNumbersArePossibleWithoutPointLines) {
  write_bytes(path("cameras.txt"), "1 PINHOLE 12 8 10 10 6 4\n");
  write_bytes(path("images.txt"),
              "1 1 0 0 0 0 0 0 1 0001\n2 1 0 0 0 0 0 0 1 0002\n3 1 0 0 0 0 0 0 1 0003\n");
  const ColmapModel model = read_colmap_model(folder());
  ASSERT_EQ(model.images.size(), 3u);
  EXPECT_EQ(model.images[2].name, "0003");
}

TEST_F(ColmapFiles, FaultsBetweenLinesAreNamedByNumberToo) {
  write_text_model(folder(), small_model(2));
  write_bytes(path("images.txt"), "1 1 0 0 0 0 0 0 7 a.png\n\n# c\n1 1 0 0 0 0 0 0 7 b.png\n");
  EXPECT_THAT(error_of(folder()),
              AllOf(HasSubstr("images.txt"), HasSubstr("image id 1 occurs twice in line 4")));
  write_bytes(path("images.txt"), "1 1 0 0 0 0 0 0 7 a.png\n2 1 0 0 0 0 0 0 3 b.png\n");
  EXPECT_THAT(error_of(folder()), AllOf(HasSubstr("names camera 3"), HasSubstr("in line 2")));
}

TEST_F(ColmapFiles, WrongLinesAreNamedByNumber) {
  write_text_model(folder(), small_model(2));
  write_bytes(path("cameras.txt"), "# c\n7 PINHOLE 12 8 10 10 6\n");
  EXPECT_THAT(error_of(folder()),
              AllOf(HasSubstr("has 4 parameters, but gives 3"), HasSubstr("line 2")));
  write_bytes(path("cameras.txt"), "# c\n\n7 PINHOLE 12 8 10 10 6 4 0.1 0.2\n");
  EXPECT_THAT(error_of(folder()),
              AllOf(HasSubstr("camera 7 is PINHOLE, which has 4 parameters, but gives 6"),
                    HasSubstr("line 3")));
  write_bytes(path("cameras.txt"), "7 PINHOLE 12 8 10 10 6 four\n");
  EXPECT_THAT(error_of(folder()), AllOf(HasSubstr("'four'"), HasSubstr("line 1")));
  write_bytes(path("cameras.txt"), "7 PINHOLE -12 8 10 10 6 4\n");
  EXPECT_THAT(error_of(folder()), HasSubstr("WIDTH is '-12'"));
  write_text_model(folder(), small_model(2));
  write_bytes(path("images.txt"), "1 1 0 0 0 0 0\n");
  EXPECT_THAT(error_of(folder()), HasSubstr("the translation is missing in line 1"));
  write_text_model(folder(), small_model(2));
  write_bytes(path("points3D.txt"), "1 0 0 0 256 0 0 0.1\n");
  EXPECT_THAT(error_of(folder()), HasSubstr("whole number from 0 to 255"));
}

TEST_F(ColmapFiles, FolderWithoutModelSaysWhatItNeeds) {
  EXPECT_THAT(error_of(folder()), HasSubstr("needs cameras.bin and images.bin"));
  write_bytes(path("cameras.bin"), "");
  write_bytes(path("images.txt"), "");
  EXPECT_THAT(error_of(folder()), HasSubstr("is not a COLMAP model"));
}

TEST_F(ColmapFiles, ObservationsAreReadWhereTheyAreAskedForFromBothEncodings) {
  ColmapModel model = small_model(3);
  model.images[0].observations = {{5, 1.25, 2.5}, {900000000000, 11.5, 7.75}};
  // the last observation has no position
  model.images[2].observations = {{900000000000, 3.0, 0.5}, {5, NAN, 1.0}};
  for (const bool binary : {true, false}) {
    std::filesystem::remove_all(folder());
    (binary ? write_binary_model : write_text_model)(folder(), model);
    const ColmapModel read = read_colmap_model(folder(), Tracks::read);
    ASSERT_EQ(read.images[0].observations.size(), 2u) << binary;
    EXPECT_EQ(read.images[0].observations[1].point_id, 900000000000u);
    EXPECT_EQ(read.images[0].observations[1].x, 11.5);
    EXPECT_EQ(read.images[0].observations[1].y, 7.75);
    EXPECT_TRUE(read.images[1].observations.empty());  // its 2D points belong to no point
    EXPECT_EQ(read.images[2].observations.size(), 1u);
    for (const ColmapImage& image : read_colmap_model(folder()).images)
      EXPECT_TRUE(image.observations.empty());
  }
}

}  // namespace
}  // namespace gs
