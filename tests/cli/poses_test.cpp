// SPDX-License-Identifier: Apache-2.0
// Runs of the built program that refine poses: their files, and what reads them.
#include <gmock/gmock.h>

#include "data_loaders/cameras/camera_file.h"
#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/text/json.h"
#include "tests/support/program.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

const std::string kRefine = "--set poses.refine=true --set poses.rate=0.001 --iterations 60";

TEST_F(Program, RefinedPosesAreWrittenDownAndMeasuredAgain) {
  write_scene(path("scene"), true);
  const Outcome trained = train("out", kRefine);
  ASSERT_EQ(trained.code, 0) << trained.err;
  const SortedJson poses = json("out/poses.json"), results = json("out/results.json");
  EXPECT_EQ(poses.at("photos").size(), 4u);  // without the two that are held out
  EXPECT_GT(poses.at("degrees"), 0);
  EXPECT_NEAR(double(poses.at("degrees")), results.at("poses").at("degrees"), 1e-3);
  EXPECT_NEAR(double(poses.at("shift")), results.at("poses").at("shift"), 1e-4);
  for (const char* split : {"test", "train"}) {
    const Outcome again =
        run("eval " + text("out") + " --device cpu --json --split " + std::string(split));
    ASSERT_EQ(again.code, 0) << again.err;
    EXPECT_NEAR(SortedJson::parse(again.out).at("psnr"), results.at(split).at("psnr"), 1e-4)
        << split;
  }
}

TEST_F(Program, RefinedPosesAreAColmapModelAndThoseOfCamerasJson) {
  write_scene(path("scene"), true);
  ASSERT_EQ(train("out", kRefine).code, 0);
  const SortedJson poses = json("out/poses.json");
  const ColmapModel model = read_colmap_model(path("out/sparse/0"), Tracks::read),
                    given = read_colmap_model(path("scene/sparse/0"), Tracks::read);
  ASSERT_EQ(model.images.size(), std::size_t(kViews));
  EXPECT_EQ(model.points.size(), given.points.size());
  EXPECT_EQ(model.cameras.begin()->second.params, given.cameras.begin()->second.params);
  std::size_t moved = 0;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    const ColmapImage& image = model.images[i];
    EXPECT_EQ(image.observations.size(), given.images[i].observations.size());
    if (!poses.at("photos").contains(image.name)) {  // held out: as given
      EXPECT_EQ(image.cam_from_world_translation, given.images[i].cam_from_world_translation);
      continue;
    }
    const auto& photo = poses.at("photos").at(image.name);
    const Mat3<double> R = rotation_matrix(image.cam_from_world_rotation);
    EXPECT_NEAR(R.row0.y, photo.at("rotation")[0][1], 1e-6);
    EXPECT_NEAR(R.row2.x, photo.at("rotation")[2][0], 1e-6);
    EXPECT_NEAR(image.cam_from_world_translation.x, photo.at("translation")[0], 1e-5);
    moved += image.cam_from_world_translation != given.images[i].cam_from_world_translation;
  }
  EXPECT_EQ(moved, 4u);
  for (const NamedCamera& named : read_cameras_json(path("out/cameras.json"))) {
    const auto found = poses.at("photos").find(named.name + ".png");
    if (found == poses.at("photos").end()) continue;
    EXPECT_NEAR(named.camera.cam_from_world_translation.y, found->at("translation")[1], 1e-5);
  }
}

TEST_F(Program, RunsThatDoNotRefinePosesHaveNoFilesOfThem) {
  write_scene(path("scene"));
  ASSERT_EQ(train("out").code, 0);
  EXPECT_FALSE(fs::exists(path("out/poses.json")));
  EXPECT_FALSE(fs::exists(path("out/sparse")));
  EXPECT_FALSE(json("out/results.json").contains("poses"));
}

TEST_F(Program, DamagedPosesAreNamedWithARemedy) {
  write_scene(path("scene"));
  ASSERT_EQ(train("out", kRefine).code, 0);
  SortedJson poses = json("out/poses.json");
  poses.at("photos").begin()->at("rotation")[0] = {2, 0, 0};
  for (const std::string& damage : {std::string("{"), std::string("{}"), poses.dump()}) {
    write_bytes(path("out/poses.json"), damage);
    const Outcome outcome = run("eval " + text("out") + " --device cpu");
    EXPECT_NE(outcome.code, 0);
    EXPECT_THAT(outcome.err, AllOf(HasSubstr("poses.json"), HasSubstr("remove the file")));
  }
}

}  // namespace
}  // namespace gs
