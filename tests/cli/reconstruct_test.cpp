// SPDX-License-Identifier: Apache-2.0
// `gemsplat reconstruct` and `gemsplat train` on bare photos as users run them, with a shell script
// in place of the program colmap.
#include <gmock/gmock.h>
#include <sys/wait.h>

#include <cmath>
#include <cstdlib>

#include "tests/support/avi_writer.h"
#include "tests/support/fake_colmap.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

constexpr int kWidth = 40, kHeight = 32;  // pixels; SSIM needs 11

/// Three photos of one size, and a colmap that always gives the same model of them.
class Reconstruct : public testing::Test {
 protected:
  Reconstruct() { write_fake_colmap(temp_.path()); }

  fs::path colmap() const { return temp_.path() / "colmap"; }
  std::string path(const std::string& name) const { return (temp_.path() / name).string(); }
  /// Returns the exit code; printed() has the output.
  int run(const std::string& arguments) const {
    const std::string command =
        std::string(GS_PROGRAM) + " " + arguments + " > " + path("out") + " 2>&1";
    return WEXITSTATUS(std::system(command.c_str()));
  }
  std::string printed() const { return read_bytes(temp_.path() / "out"); }

  TempFolder temp_;
};

TEST_F(Reconstruct, EndsWithAVerdictAndTheNextCommand) {
  ASSERT_EQ(
      run("reconstruct " + path("photos") + " -o " + path("scene") + " --colmap " + path("colmap")),
      0)
      << printed();
  EXPECT_THAT(printed(), AllOf(HasSubstr("3 of 3 photos placed"), HasSubstr("gemsplat train ")));
  EXPECT_TRUE(is_colmap_model(path("scene/sparse/0")));
}

TEST_F(Reconstruct, WithoutAFolderTheSceneStandsBesideThePhotosAndIsGoneOnWith) {
  const std::string command = "reconstruct " + path("photos") + " --colmap " + path("colmap");
  for (int call = 0; call < 2; ++call) {
    ASSERT_EQ(run(command), 0) << printed();
    EXPECT_THAT(printed(), AllOf(HasSubstr("writing to " + path("photos-scene") + "; -o"),
                                 HasSubstr("gemsplat train " + path("photos-scene") + "\n")));
  }
  EXPECT_FALSE(fs::exists(path("photos-scene-2")));
}

TEST_F(Reconstruct, MissingProgramIsBadData) {
  EXPECT_EQ(run("reconstruct " + path("photos") + " -o " + path("scene") + " --colmap /no/colmap"),
            3);
  EXPECT_THAT(printed(), AllOf(HasSubstr("apt install colmap"), HasSubstr("--colmap PATH")));
}

TEST_F(Reconstruct, TrainOnBarePhotosMakesTheSceneFirstAndNamesItInItsConfig) {
  const std::string train =
      "train " + path("photos") + " -o " + path("run") +
      " --iterations 5 --device cpu --set reconstruct.colmap=" + path("colmap");
  ASSERT_EQ(run(train), 0) << printed();
  EXPECT_THAT(printed(), HasSubstr("3 of 3 photos placed"));
  EXPECT_TRUE(is_colmap_model(path("run/scene/sparse/0")));
  EXPECT_THAT(read_bytes(path("run/config.toml")), HasSubstr(path("run/scene")));
  EXPECT_EQ(run(train + " --force"), 0) << printed();
  EXPECT_TRUE(is_colmap_model(path("run.bak-1/scene/sparse/0")));
  EXPECT_EQ(run("eval " + path("run") + " --split train"), 0) << printed();
}

TEST_F(Reconstruct, ASceneWithCamerasAndWithoutPointsKeepsItsCameras) {
  ColmapModel model = read_colmap_model(path("model"));
  fs::create_directories(path("posed"));
  fs::rename(path("photos"), path("posed/images"));
  model.points.clear();
  write_binary_model(path("posed/sparse/0"), model);
  write_bytes(
      colmap(),
      "#!/bin/sh\n"
      "case \"$1 $2\" in 'mapper --'*) exit 1;; 'point_triangulator --'*) ;; *) exit 0;; esac\n"
      "while [ \"$1\" != --output_path ]; do shift; done\n"
      "cp '" +
          path("model") + "'/* \"$2\"\n");
  ASSERT_EQ(
      run("reconstruct " + path("posed") + " -o " + path("scene") + " --colmap " + path("colmap")),
      0)
      << printed();
  EXPECT_THAT(printed(), AllOf(HasSubstr("cameras and no points"), HasSubstr("3 of 3 photos")));
  EXPECT_EQ(read_colmap_model(path("scene/sparse/0")).points.size(), 2u);
  EXPECT_TRUE(fs::exists(path("scene/images/a.png")));
}

TEST_F(Reconstruct, TrainStopsWherePosesOfAnotherProgramLieBesideThePhotos) {
  const std::string train =
      "train " + path("photos") + " -o " + path("run") +
      " --iterations 5 --device cpu --set reconstruct.colmap=" + path("colmap");
  write_bytes(path("photos/walk.psx"), "<document version=\"1.2.0\"/>");  // a project
  EXPECT_EQ(run(train), 2);
  EXPECT_THAT(printed(), AllOf(HasSubstr("walk.psx"), HasSubstr("Metashape")));
  EXPECT_FALSE(fs::exists(path("run/scene")));
  // An export is read, and this one has no pose.
  write_bytes(path("photos/cameras.xml"), "<document version=\"2.0.0\"><chunk/></document>");
  EXPECT_EQ(run(train), 3);
  EXPECT_THAT(printed(), AllOf(HasSubstr("cameras.xml"), HasSubstr("Metashape")));
  EXPECT_FALSE(fs::exists(path("run/scene")));
}

TEST_F(Reconstruct, ARunKilledBeforeItsFirstCheckpointKeepsTheSceneOfItsPhotos) {
  const std::string train = "train " + path("photos") + " -o " + path("run") +
                            " --iterations 5 --device cpu --resume auto" +
                            " --set reconstruct.colmap=" + path("colmap");
  ASSERT_EQ(run(train), 0) << printed();
  for (const char* made : {"checkpoints", "point_cloud", "results.json"})
    fs::remove_all(path("run") + "/" + made);  // as if killed at the first step
  write_bytes(path("run/scene/database.db"), "hours of work");
  EXPECT_EQ(run(train), 0) << printed();
  EXPECT_EQ(read_bytes(path("run/scene/database.db")), "hours of work");
  fs::remove_all(path("run/checkpoints"));
  fs::remove_all(path("run/point_cloud"));
  fs::remove(path("run/results.json"));
  EXPECT_EQ(run(train + " --set train.seed=3"), 0) << printed();
  EXPECT_EQ(read_bytes(path("run/scene/database.db")), "hours of work");
  EXPECT_TRUE(fs::exists(path("run/config.toml.bak-1")));
  EXPECT_FALSE(fs::exists(path("run.bak-1")));
}

TEST_F(Reconstruct, TrainWithForceKeepsTheOldRunInPlaceWhereColmapIsMissing) {
  write_bytes(path("run/cfg_args"), "an older run");
  EXPECT_EQ(run("train " + path("photos") + " -o " + path("run") +
                " --force --device cpu --set reconstruct.colmap=/no/colmap"),
            3);
  EXPECT_THAT(printed(), HasSubstr("--set reconstruct.colmap=PATH"));
  EXPECT_EQ(read_bytes(path("run/cfg_args")), "an older run");
  EXPECT_FALSE(fs::exists(path("run.bak-1")));
}

TEST_F(Reconstruct, TrainOnAVideoTakesFramesFirst) {
  std::vector<Image8> frames;
  for (int i = 0; i < 3; ++i) frames.push_back(plain_photo(kWidth, kHeight, std::uint8_t(50 * i)));
  write_avi(path("walk.avi"), frames);
  ColmapModel model = read_colmap_model(path("model"));
  for (std::size_t i = 0; i < 3; ++i)
    model.images[i].name = "walk_00000" + std::to_string(i) + ".png";
  write_binary_model(path("model"), model);
  const int code = run("train " + path("walk.avi") + " -o " + path("run") +
                       " --iterations 3 --device cpu --set reconstruct.colmap=" + path("colmap"));
  if (code != 0 && printed().find("no OpenCV") != std::string::npos)
    GTEST_SKIP() << "built without OpenCV";
  EXPECT_EQ(code, 0) << printed();
  EXPECT_TRUE(fs::exists(path("run/scene/images/walk_000002.png")));
}

}  // namespace
}  // namespace gs
