// SPDX-License-Identifier: Apache-2.0
// rigs and frames of COLMAP 3.12 and later, and the split that keeps frames whole.
#include <gmock/gmock.h>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/scene/scene_model.h"
#include "gs_core/error.h"
#include "tests/support/load_scene.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

/// Two cameras on a rig that took `moments` photos each: left/0.png and right/0.png, left/1.png ...
/// The order of image ids and frames gives no hint.
ColmapModel stereo_model(int moments) {
  ColmapModel model = small_model(0);
  model.cameras[8] = model.cameras[7];
  model.cameras[8].id = 8;
  const double h = std::sqrt(0.5);
  model.rigs.push_back(
      {4, {{7, true, {1, 0, 0, 0}, {0.0, 0.0, 0.0}}, {8, true, {h, 0, h, 0}, {-0.1, 0.25, 0.0}}}});
  model.rigs.push_back(
      {5, {{9, true, {1, 0, 0, 0}, {0.0, 0.0, 0.0}}, {10, false, {1, 0, 0, 0}, {0.0, 0.0, 0.0}}}});
  for (int i = moments - 1; i >= 0; --i) {
    const std::uint32_t left = 100 - 2 * i, right = left + 1;
    const std::string name = std::to_string(i) + ".png";
    model.images.push_back({left, "left/" + name, 7, {1, 0, 0, 0}, {-double(i), 0.0, 0.0}});
    model.images.push_back({right, "right/" + name, 8, {1, 0, 0, 0}, {-double(i), 1.0, 0.0}});
    model.frames.push_back({std::uint32_t(i + 1), 4, {right, left, 999}});  // 999: not registered
  }
  for (std::size_t i = 0; i < model.frames.size(); ++i) model.frames[i].image_ids[2] += i;
  return model;
}

void expect_same_rigs(const ColmapModel& a, const ColmapModel& b) {
  ASSERT_EQ(a.rigs.size(), b.rigs.size());
  for (std::size_t i = 0; i < a.rigs.size(); ++i) {
    EXPECT_EQ(a.rigs[i].id, b.rigs[i].id);
    ASSERT_EQ(a.rigs[i].cameras.size(), b.rigs[i].cameras.size());
    for (std::size_t k = 0; k < a.rigs[i].cameras.size(); ++k) {
      const ColmapRigCamera &x = a.rigs[i].cameras[k], &y = b.rigs[i].cameras[k];
      EXPECT_EQ(x.camera_id, y.camera_id);
      EXPECT_EQ(x.has_pose, y.has_pose);
      EXPECT_NEAR(x.cam_from_rig_rotation.w, y.cam_from_rig_rotation.w, 1e-15);
      EXPECT_NEAR(x.cam_from_rig_rotation.y, y.cam_from_rig_rotation.y, 1e-15);
      EXPECT_EQ(x.cam_from_rig_translation, y.cam_from_rig_translation);
    }
  }
  ASSERT_EQ(a.frames.size(), b.frames.size());
  for (std::size_t i = 0; i < a.frames.size(); ++i) {
    EXPECT_EQ(a.frames[i].id, b.frames[i].id);
    EXPECT_EQ(a.frames[i].rig_id, b.frames[i].rig_id);
    EXPECT_EQ(a.frames[i].image_ids, b.frames[i].image_ids);
  }
}

/// The message of reading `folder`: an Error, or else a warning that the rigs are left out.
std::string complaint_of(const std::filesystem::path& folder) {
  CapturedLog logged;
  try {
    EXPECT_THAT(read_colmap_model(folder).rigs, IsEmpty());
  } catch (const Error& error) {
    return logged.text() + error.what();
  }
  const std::string& log = logged.text();
  EXPECT_THAT(log, HasSubstr("going on without rigs"));
  return log;
}

class Rigs : public SceneTest {};

TEST_F(Rigs, BinaryAndTextGiveWhatWasWritten) {
  const ColmapModel model = stereo_model(3);
  write_binary_model(path("bin"), model);
  write_text_model(path("txt"), model);
  expect_same_rigs(read_colmap_model(path("bin")), model);
  expect_same_rigs(read_colmap_model(path("txt")), model);
}

TEST_F(Rigs, EitherFileMayBeAbsent) {
  write_binary_model(folder(), stereo_model(2));
  std::filesystem::remove(path("rigs.bin"));
  EXPECT_THAT(read_colmap_model(folder()).rigs, IsEmpty());
  EXPECT_EQ(read_colmap_model(folder()).frames.size(), 2u);
  std::filesystem::remove(path("frames.bin"));
  EXPECT_THAT(read_colmap_model(folder()).frames, IsEmpty());
  write_bytes(path("frames.txt"), "of the other encoding, so not looked at");
  EXPECT_THAT(read_colmap_model(folder()).frames, IsEmpty());
}

TEST_F(Rigs, TruncationAtEveryByteNamesTheFile) {
  write_binary_model(folder(), stereo_model(2));
  for (const char* name : {"rigs.bin", "frames.bin"}) {
    const std::string whole = read_bytes(path(name));
    for (std::size_t size = 0; size < whole.size(); ++size) {
      write_bytes(path(name), whole.substr(0, size));
      ASSERT_THAT(complaint_of(folder()), AllOf(HasSubstr(name), HasSubstr("byte"))) << size;
    }
    write_bytes(path(name), whole + "x");
    EXPECT_THAT(complaint_of(folder()), HasSubstr("1 bytes follow"));
    write_bytes(path(name), whole);
  }
}

TEST_F(Rigs, FaultsAreNamedWithTheirLine) {
  write_text_model(folder(), stereo_model(1));
  const struct {
    const char *file, *text, *complaint;
  } faults[] = {
      {"rigs.txt", "# c\n1 1 CAMERA 7\n1 1 CAMERA 8\n", "rig id 1 occurs twice in line 3"},
      {"rigs.txt", "1 2 CAMERA 7 CAMERA 8 1 0 0 0 0 0 0 0\n", "zero quaternion in line 1"},
      {"rigs.txt", "1 2 CAMERA 7 CAMERA 8 1 nan 0 0 0 0 0 0\n", "not finite in line 1"},
      {"rigs.txt", "1 4000000000 CAMERA 7\n", "SENSOR_ID is missing in line 1"},
      {"rigs.txt", "1 2 0 7\n0 8 0\n", "SENSOR_ID is missing in line 1"},  // sensors in lines
      {"rigs.txt", "", nullptr},
      {"frames.txt", "1 1 1 0 0 0 0 0 0 2 CAMERA 7 5\n", "SENSOR_ID is missing in line 1"},
      {"frames.txt", "1 1 1 0 0 0 0 0 0 1 CAMERA 7 x\n", "DATA_ID is 'x'"},
      {"frames.txt", "1 1 1 0 0 0 0 0 0 0\n1 1 1 0 0 0 0 0 0 0\n", "frame id 1 occurs twice"},
      {"frames.txt", "1 1 1 0 0 0 0 0 0 1 CAMERA 7 5\n2 1 1 0 0 0 0 0 0 1 CAMERA 7 5\n",
       "image 5 belongs to frame 2 and to one before it in line 2"},
  };
  for (const auto& fault : faults) {
    write_bytes(path(fault.file), fault.text);
    if (fault.complaint)
      EXPECT_THAT(complaint_of(folder()), AllOf(HasSubstr(fault.file), HasSubstr(fault.complaint)));
    else
      EXPECT_NO_THROW(read_colmap_model(folder()));
  }
}

TEST_F(Rigs, KindsOfSensorMayBeNumbersInText) {
  write_text_model(folder(), stereo_model(1));
  write_bytes(path("rigs.txt"), "4 2 0 7 1 3 0\r\n");
  write_bytes(path("frames.txt"), "1 4 1 0 0 0 0 0 0 3 0 7 100 1 3 101 0 8 102\r\n");
  const ColmapModel model = read_colmap_model(folder());
  ASSERT_EQ(model.rigs.size(), 1u);
  EXPECT_EQ(model.rigs[0].cameras.size(), 1u);
  ASSERT_EQ(model.frames.size(), 1u);
  EXPECT_THAT(model.frames[0].image_ids, ElementsAre(100, 102));
}

TEST_F(Rigs, ViewsOfOneFrameAreOnOneSideOfTheSplit) {
  for (const bool binary : {true, false}) {
    std::filesystem::remove_all(folder());
    const ColmapModel model = stereo_model(5);
    write(model);
    if (!binary) {
      std::filesystem::remove_all(path("sparse/0"));
      write_text_model(path("sparse/0"), model);
    }
    DatasetConfig dataset = dataset_at(folder());
    dataset.eval = true;
    dataset.test_every = 3;
    const Scene scene = load_scene(dataset);
    EXPECT_THAT(names_of(scene.test_views),
                ElementsAre("left/0.png", "left/3.png", "right/0.png", "right/3.png"));
    EXPECT_THAT(names_of(scene.train_views),
                ElementsAre("left/1.png", "left/2.png", "left/4.png", "right/1.png", "right/2.png",
                            "right/4.png"));
  }
}

/// Ordinary models, with or without frames of one photo each, follow the rule for photos.
TEST(Split, FramesOfOnePhotoChangeNothing) {
  ColmapModel model = small_model(20);
  DatasetConfig dataset;
  dataset.eval = true;
  for (int every : {2, 7, 8, 19}) {
    dataset.test_every = every;
    std::vector<bool> expected;
    for (int i = 0; i < 20; ++i) expected.push_back(i % every == 0);
    model.frames.clear();
    EXPECT_EQ(test_views_of(dataset, model), expected);
    for (std::uint32_t i = 0; i < 20; ++i) model.frames.push_back({50 - i, 1, {20 - i}});
    EXPECT_EQ(test_views_of(dataset, model), expected);
  }
  dataset.eval = false;
  EXPECT_EQ(test_views_of(dataset, model), std::vector<bool>(20, false));
}

TEST(Split, PhotosOutsideOfFramesAreFramesOfTheirOwn) {
  ColmapModel model = small_model(6);  // ids 1 to 6
  model.frames.push_back({1, 1, {2, 5}});
  DatasetConfig dataset;
  dataset.eval = true;
  dataset.test_every = 2;  // a | b e | c | d | f
  EXPECT_THAT(test_views_of(dataset, model), ElementsAre(true, false, true, false, false, true));
}

TEST(Split, OneFrameThatHoldsEverythingLeavesNothing) {
  ColmapModel model = small_model(3);
  model.frames.push_back({1, 1, {1, 2, 3}});
  DatasetConfig dataset;
  dataset.eval = true;
  EXPECT_THAT(error_of([&] { test_views_of(dataset, model); }),
              AllOf(HasSubstr("no view is left"), HasSubstr("1 rig frames")));
}

}  // namespace
}  // namespace gs
