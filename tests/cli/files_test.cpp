// SPDX-License-Identifier: Apache-2.0
// Nothing of a user's is lost: what the built program does to folders and files that it did not make,
// and what a scene that disappears or a file that is missing costs a run.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <unistd.h>

#include <map>
#include <thread>

#include "data_loaders/photos/photo_cache.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/video/video_frames.h"
#include "gs_core/system/files/output_lock.h"
#include "tests/support/avi_writer.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class Files : public Program {
 protected:
  // Every file below a folder, by name.
  std::map<std::string, std::string> contents(const std::string& folder) const {
    std::map<std::string, std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(path(folder)))
      if (entry.is_regular_file())
        files[fs::relative(entry.path(), path(folder)).string()] = read_bytes(entry.path());
    return files;
  }
  // Starts the program; its process.
  pid_t start(const std::string& arguments) {
    const pid_t child = ::fork();
    if (child != 0) return child;
    const int log = ::open(text("log.txt").c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    ::dup2(log, 1);
    ::dup2(log, 2);
    const std::string command = std::string("exec ") + GS_PROGRAM + " " + arguments;
    ::execl("/bin/sh", "sh", "-c", command.c_str(), static_cast<char*>(nullptr));
    ::_exit(127);
  }
  // Waits until a file is there, or the program is over. Whether the file is there.
  bool wait_for_file(const fs::path& file, pid_t child) {
    while (!fs::exists(file)) {
      siginfo_t info{};
      ::waitid(P_PID, id_t(child), &info, WEXITED | WNOHANG | WNOWAIT);
      if (info.si_pid == child) return fs::exists(file);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return true;
  }
  static int end_of(pid_t child) {
    int status = 0;
    ::waitpid(child, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }
  std::string command(const std::string& scene, const std::string& out) const {
    return "train " + text(scene) + " -o " + text(out) + kTrain + " --threads 1 ";
  }
};

TEST_F(Files, ForceDoesNotMoveTheSceneOrWhatHoldsIt) {
  write_scene(path("p/scene"));
  write_bytes(path("p/config.toml"), "# a run, as it seems\n");
  write_bytes(path("p/scene/config.toml"), "# another\n");
  fs::create_directory_symlink(path("p/scene"), path("link"));
  const auto before = contents("p");
  for (const char* out : {"p/scene", "p/scene/", "link", "p", "p/scene/../../p", "link/.."}) {
    const Outcome refused = run(command("p/scene", out) + "--force");
    EXPECT_EQ(refused.code, 2) << out << ": " << refused.err;
    EXPECT_THAT(refused.err, AllOf(HasSubstr("which this command reads"), HasSubstr("-o"))) << out;
    EXPECT_THAT(refused.err, Not(HasSubstr("steps"))) << out;  // before training
  }
  EXPECT_EQ(run(command("link", "p/scene") + "--force").code, 2);
  EXPECT_EQ(run(command("p/scene", "p") + "--resume auto").code, 2);  // moves without --force, too
  EXPECT_EQ(contents("p"), before);
  EXPECT_FALSE(fs::exists(path("p.bak-1")) || fs::exists(path("p/scene.bak-1")));
}

TEST_F(Files, ForceDoesNotMoveTheCurrentFolder) {
  ASSERT_EQ(train("run").code, 0);
  const auto before = contents("run");
  const Outcome refused =
      run("train " + text("scene") + " -o ." + kTrain + " --force", "cd " + text("run") + " && ");
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("the current folder"));
  EXPECT_EQ(contents("run"), before);
}

TEST_F(Files, ALinkToAFolderThatIsBeingTrainedIntoIsRefused) {
  write_scene(path("scene"));
  fs::create_directories(path("busy"));
  fs::create_directory_symlink(path("busy"), path("link"));
  const pid_t first = start(command("scene", "link") + "--iterations 1000000");
  ASSERT_TRUE(wait_for_file(path("busy/metrics.csv"), first)) << read_bytes(path("log.txt"));
  for (const char* out : {"busy", "link", "link/"}) {
    const Outcome second = run(command("scene", out) + "--resume auto");
    EXPECT_EQ(second.code, 3) << out;
    EXPECT_THAT(second.err, HasSubstr("another process")) << out;
  }
  EXPECT_FALSE(fs::exists(path(".busy.lock")));
  ::kill(first, SIGKILL);
  end_of(first);
}

TEST_F(Files, AClosedTerminalStopsTrainingAsCtrlCDoes) {
  write_scene(path("scene"));
  const pid_t child = start(command("scene", "out") + "--iterations 1000000 --checkpoint-every 5");
  ASSERT_TRUE(wait_for_file(path("out/checkpoints/step_5.ckpt"), child));
  for (int i = 0; i < 2; ++i) ::kill(child, SIGHUP);  // as when bash ends
  EXPECT_EQ(end_of(child), 5) << read_bytes(path("log.txt"));
  EXPECT_FALSE(fs::exists(path("out/.gemsplat.lock")));
}

TEST_F(Files, ASignalKeepsThePicturesSoFarAndNoHalfOfAFilm) {
  ASSERT_EQ(train("run").code, 0);
  const std::string render =
      "render " + text("run") + " --device cpu --path orbit --frames 100000 --size 320x256 -o ";
  const pid_t pictures = start(render + text("views"));
  ASSERT_TRUE(wait_for_file(path("views/00000.png"), pictures)) << read_bytes(path("log.txt"));
  ::kill(pictures, SIGTERM);
  EXPECT_EQ(end_of(pictures), 5) << read_bytes(path("log.txt"));
  EXPECT_TRUE(fs::exists(path("views/00000.png")));
  EXPECT_FALSE(fs::exists(path("views/.gemsplat.lock")));
  if (!can_read_videos()) GTEST_SKIP() << "built without OpenCV's videoio";
  fs::create_directories(path("films"));
  const pid_t film = start(render + text("films/orbit.mp4"));
  while (std::distance(fs::directory_iterator(path("films")), {}) < 2) ::usleep(10'000);
  ::kill(film, SIGTERM);
  EXPECT_EQ(end_of(film), 5) << read_bytes(path("log.txt"));
  EXPECT_TRUE(fs::is_empty(path("films")));
}

TEST_F(Files, ASceneThatDisappearsWhileARunGoesOnDoesNotFailIt) {
  write_scene(path("scene"));
  const pid_t child =
      start(command("scene", "out") + "-c adaptive --iterations 1500 --checkpoint-every 5");
  ASSERT_TRUE(wait_for_file(path("out/checkpoints/step_5.ckpt"), child));
  fs::rename(path("scene"), path("elsewhere"));
  ASSERT_EQ(end_of(child), 0) << read_bytes(path("log.txt"));
  EXPECT_EQ(json("out/results.json").at("scene_hash").get<std::string>().size(), 16u);
}

TEST_F(Files, APhotoThatWasReplacedIsNoticedWhenARunGoesOn) {
  write_scene(path("scene"));
  const pid_t child = start(command("scene", "out") + "--iterations 1000000 --checkpoint-every 5");
  ASSERT_TRUE(wait_for_file(path("out/checkpoints/step_5.ckpt"), child));
  ::kill(child, SIGKILL);
  end_of(child);
  fs::copy(path("scene"), path("other"), fs::copy_options::recursive);
  fs::copy_file(path("scene/images/view_1.png"), path("other/images/view_2.png"),
                fs::copy_options::overwrite_existing);
  const std::string resume = " --resume " + text("out") + " --device cpu";
  const Outcome refused = run("train " + text("other") + resume);
  EXPECT_EQ(refused.code, 3);
  EXPECT_THAT(refused.err, HasSubstr("the file of view_2.png is another photo than it was"));
}

TEST_F(Files, ARunOnVideosGoesOnToTheSameBytesWithTheFramesOnDisk) {
  if (!can_read_videos() || !can_cache_photos()) GTEST_SKIP() << "built without a library for it";
  write_scene(path("scene"));
  for (int v = 0; v < kViews; ++v) {
    const fs::path photo = path("scene/images/view_" + std::to_string(v) + ".png");
    std::vector<Image8> frames(4, read_photo(photo));
    for (int i = 0; i < 4; ++i)
      for (std::uint8_t& value : frames[std::size_t(i)].pixels)
        value = std::uint8_t(value - 20 * i);
    write_avi(fs::path(photo).replace_extension(".avi"), frames);
    fs::remove(photo);
  }
  const std::string films =
      "--set dataset.times=frames --set model.dynamic=true --iterations 400 "
      "--set dataset.test_names=view_0,view_4 --checkpoint-every 50 ";
  const std::string cached = films + "--photo-ram 6.5e-5 --photo-cache " + text("cache");
  const Outcome whole = run(command("scene", "whole") + films);
  ASSERT_EQ(whole.code, 0) << whole.err;
  const pid_t child = start(command("scene", "out") + cached);
  ASSERT_TRUE(wait_for_file(path("out/checkpoints/step_50.ckpt"), child));
  ::kill(child, SIGKILL);
  end_of(child);
  EXPECT_EQ(contents("cache").size(), 24u);
  const Outcome resumed = run(command("scene", "out") + cached + " --resume");
  ASSERT_EQ(resumed.code, 0) << resumed.err;
  const std::string ply = "point_cloud/iteration_400/point_cloud.ply";
  EXPECT_TRUE(read_bytes(path("out/" + ply)) == read_bytes(path("whole/" + ply)));
  EXPECT_EQ(json("out/split.json").at("test").size(), 8u);
}

TEST_F(Files, ExportsThatAKillHasCutOffAreWrittenByTheSameCommand) {
  const std::string formats = "--export spz,splat";
  const Outcome whole = train("run", formats);
  if (whole.err.find("has no zlib") != std::string::npos) GTEST_SKIP() << "built without zlib";
  ASSERT_EQ(whole.code, 0) << whole.err;
  const std::string folder = "run/point_cloud/iteration_20/";
  const auto before = contents("run");
  fs::remove(path(folder + "point_cloud.spz"));  // as after a kill right behind results.json
  fs::remove(path(folder + "point_cloud.spz.transforms.json"));
  const Outcome again = train("run", formats + " --resume auto");
  EXPECT_EQ(again.code, 0) << again.err;
  EXPECT_THAT(again.err, HasSubstr("exports are missing"));
  EXPECT_EQ(contents("run"), before);
  EXPECT_THAT(train("run", formats + " --resume auto").err, HasSubstr("extends it"));
}

TEST_F(Files, AnExportThatAKillHasCutOffWhileItWasMeasuredIsMeasuredByTheSameCommand) {
  const std::string formats = "--export spz";
  const Outcome whole = train("run", formats);
  if (whole.err.find("has no zlib") != std::string::npos) GTEST_SKIP() << "built without zlib";
  ASSERT_EQ(whole.code, 0) << whole.err;
  const std::string sidecar = "run/point_cloud/iteration_20/point_cloud.spz.transforms.json";
  const std::string before = read_bytes(path(sidecar));
  auto unmeasured = json(sidecar);
  ASSERT_EQ(unmeasured.erase("fidelity"), 1u);
  write_bytes(path(sidecar), unmeasured.dump());
  EXPECT_THAT(train("run", formats + " --resume auto").err, HasSubstr("exports are missing"));
  EXPECT_EQ(read_bytes(path(sidecar)), before);
}

TEST_F(Files, APathThatIsNotUtf8IsRefusedBeforeTraining) {
  write_scene(
      path("sc\xff"
           "ne"));
  const Outcome scene =
      run(command("sc\xff"
                  "ne",
                  "out"));
  EXPECT_EQ(scene.code, 2);
  EXPECT_THAT(scene.err, AllOf(HasSubstr("dataset.source"), HasSubstr("not UTF-8")));
  EXPECT_FALSE(fs::exists(path("out")));
  write_scene(path("scéne"));
  EXPECT_EQ(run(command("scéne", "o\xe9")).code, 2);
  ASSERT_EQ(run(command("scéne", "öut")).code, 0);
  EXPECT_EQ(run("eval " + text("öut") + " --device cpu").code, 0);
}

TEST_F(Files, ALineEndInAnExperimentsNameBecomesNoCommand) {
  write_scene(path("scene"));
  const std::string experiment = "output = 'runs'\nscenes = ['scene']\n";
  write_bytes(path("a\ntouch owned\n.toml"), experiment);
  const std::string dry = " --slurm --dry-run";
  const Outcome refused = run("experiment '" + text("a\ntouch owned\n.toml") + "'" + dry);
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("control characters"));
  EXPECT_FALSE(fs::exists(path("runs/experiment.sbatch")));
  write_bytes(path("b.toml"), experiment + "slurm = {\"x\\ntouch owned\\n#\" = 1}\n");
  EXPECT_EQ(run("experiment " + text("b.toml") + dry).code, 2);
  EXPECT_FALSE(fs::exists(path("runs/experiment.sbatch")));
}

TEST_F(Files, AFileThatIsNoOutputOfOursIsKeptAside) {
  ASSERT_EQ(train("run").code, 0);
  write_bytes(path("mine.json"), "dear");
  ASSERT_EQ(run("eval " + text("run") + " --device cpu -o " + text("mine.json")).code, 0);
  EXPECT_EQ(read_bytes(path("mine.json.bak-1")), "dear");
  write_bytes(path("mine.html"), "dear");
  const Outcome report = run("report " + text("run") + " -o " + text("mine.html"));
  if (report.code != 0) GTEST_SKIP() << report.err;  // a build without npm
  EXPECT_EQ(read_bytes(path("mine.html.bak-1")), "dear");
  ASSERT_EQ(run("report " + text("run") + " -o " + text("mine.html")).code, 0);
  EXPECT_FALSE(fs::exists(path("mine.html.bak-2")));  // that one was ours
}

TEST_F(Files, ACopyOfASceneThatWasCutOffIsMadeAgainWithForce) {
  write_scene(path("scene"));
  const std::string command = "undistort " + text("scene") + " -o " + text("flat");
  write_bytes(path("flat/images/view_0.png"), "half of a photo");  // as a kill leaves it
  const Outcome refused = run(command);
  EXPECT_EQ(refused.code, 2) << refused.err;
  EXPECT_THAT(refused.err, HasSubstr("--force"));
  EXPECT_EQ(run(command + " --force").code, 0);
  EXPECT_TRUE(fs::exists(path("flat/sparse/0/points3D.bin")));
  EXPECT_EQ(read_bytes(path("flat.bak-1/images/view_0.png")), "half of a photo");
  const Outcome into_the_scene = run("undistort " + text("scene") + " --force -o " + text("scene"));
  EXPECT_EQ(into_the_scene.code, 2) << into_the_scene.err;
  EXPECT_TRUE(fs::exists(path("scene/images/view_0.png")));
}

TEST_F(Files, TwoWritersOfOneFileAreRefused) {
  ASSERT_EQ(train("run").code, 0);
  const auto is_refused = [&](const std::string& file, const std::string& arguments) {
    const OutputLock first = OutputLock::of_file(path(file));
    const Outcome second = run(arguments);
    EXPECT_EQ(second.code, 3) << arguments << second.err;
    EXPECT_THAT(second.err, AllOf(HasSubstr("another process"), HasSubstr(file))) << arguments;
    EXPECT_FALSE(fs::exists(path(file))) << arguments;
  };
  is_refused("scene/georef.json", "georef " + text("scene") + " --origin 15,48,0 --force");
  is_refused("a.png", "edit " + text("run") + " --recenter --dry-run --picture " + text("a.png") +
                          " --device cpu --force");
  is_refused("e.json", "eval " + text("run") + " --device cpu -o " + text("e.json"));
  is_refused("b.json", "bench --gaussians 10 --device cpu -o " + text("b.json"));
  is_refused("r.html", "report " + text("run") + " -o " + text("r.html"));
  is_refused("m.spz", "export " + text("run") + " " + text("m.spz") + " --no-measure --force");
  fs::create_directories(path("views"));
  const OutputLock first = OutputLock::of_folder(path("views"));
  const Outcome second = run("render " + text("run") + " --device cpu -o " + text("views"));
  EXPECT_EQ(second.code, 3) << second.err;
  EXPECT_THAT(second.err, HasSubstr("another process"));
  EXPECT_EQ(run("georef " + text("scene") + " --origin 15,48,0").code, 0);
  EXPECT_FALSE(fs::exists(path("scene/.georef.json.lock")));
}

}  // namespace
}  // namespace gs
