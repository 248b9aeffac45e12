// SPDX-License-Identifier: Apache-2.0
// Training never loses work: the built `gemsplat train` is killed at random moments, stopped,
// damaged, resumed and extended, on a scene of six small pictures. The files of a resumed run are
// compared byte by byte with those of an uninterrupted one.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <fstream>
#include <sstream>
#include <thread>

#include "gs_core/math/random.h"
#include "gs_core/system/text/json.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;

constexpr int kSteps = 60;
constexpr int kKills = 50;
constexpr std::uint64_t kSeed = 11;  // for the moments of the kills
const std::string kResumable =
    " --eval --test-every 3 --device cpu --threads 1 --checkpoint-every 4 --set train.log_every=5 "
    "--set "
    "density.from_step=10 --set density.every=10 --set density.gradient_threshold=1e-5 "
    "--background "
    "random";

// The file without times, in which two runs always differ.
std::string without_times(const fs::path& file) {
  const std::string text = read_bytes(file);
  if (file.filename() == "results.json") {
    auto json = SortedJson::parse(text);
    for (const char* key : {"train_seconds", "wall_seconds", "date", "peak_host_bytes"})
      json.erase(key);
    return json.dump();
  }
  if (file.filename() == "profile.csv" || file.filename() == "report.html") return "";
  if (file.filename() != "metrics.csv") return text;
  std::istringstream lines(text);
  std::string result;
  for (std::string line; std::getline(lines, line);) {
    std::vector<std::string> words;
    std::istringstream columns(line);
    for (std::string word; std::getline(columns, word, ',');) words.push_back(word);
    for (std::size_t i = 0; i < words.size(); ++i)
      if (i != 3 && i != 4) result += words[i] + ",";
    result += "\n";
  }
  return result;
}

// All files of a run that do not depend on time or place.
std::map<std::string, std::string> contents_of(const fs::path& run) {
  std::map<std::string, std::string> contents;
  for (const auto& entry : fs::recursive_directory_iterator(run)) {
    const std::string name = fs::relative(entry.path(), run).string();
    const bool depends = name == "config.toml" || name == "cfg_args" || name.ends_with(".ckpt");
    if (entry.is_regular_file() && !depends) contents[name] = without_times(entry.path());
  }
  return contents;
}

class Resume : public ::testing::Test {
 protected:
  void SetUp() override { write_scene(path("scene")); }

  fs::path path(const std::string& name) const { return folder_.path() / name; }
  std::string text(const std::string& name) const { return path(name).string(); }

  // Starts the program and returns its process.
  pid_t start(const std::string& arguments) {
    const pid_t child = fork();
    if (child != 0) return child;
    const auto redirect = [&](const char* name, int descriptor) {
      ::dup2(::open(text(name).c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600), descriptor);
    };
    redirect("stdout.txt", 1);
    redirect("stderr.txt", 2);
    const std::string command = std::string("exec ") + GS_PROGRAM + " " + arguments;
    ::execl("/bin/sh", "sh", "-c", command.c_str(), static_cast<char*>(nullptr));
    ::_exit(127);
  }
  Outcome wait_for(pid_t child) {
    int status = 0;
    ::waitpid(child, &status, 0);
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status),
            read_bytes(path("stdout.txt")), read_bytes(path("stderr.txt"))};
  }
  Outcome run(const std::string& arguments) { return wait_for(start(arguments)); }
  std::string command(const std::string& out, const std::string& more = "") const {
    return "train " + text("scene") + " -o " + text(out) + kResumable + " --iterations " +
           std::to_string(kSteps) + " " + more;
  }
  // Runs until `out` has a checkpoint of this step or a later one, then sends a signal. The code is
  // 0 if the run was over before.
  Outcome run_and_signal(const std::string& arguments, const fs::path& out, int step, int signal) {
    const pid_t child = start(arguments);
    while (newest_step(out) < step) {
      if (::waitpid(child, nullptr, WNOHANG) == child) return {0, {}, {}};
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    ::kill(child, signal);
    return wait_for(child);
  }
  static int newest_step(const fs::path& out) {
    int newest = 0;
    std::error_code none;  // a folder that is not there yet, or changes, is looked at again
    for (fs::directory_iterator file(out / "checkpoints", none), end; !none && file != end;
         file.increment(none))
      if (file->path().extension() == ".ckpt")
        newest = std::max(newest, std::stoi(file->path().stem().string().substr(5)));
    return newest;
  }

 private:
  TempFolder folder_;
};

void kill_after(double seconds, pid_t child) {
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  ::kill(child, SIGKILL);
}

// Notes how a run has ended, which goes on with `--resume auto`.
void count(const Outcome& outcome, int& kills, int& resumed, bool& is_finished) {
  is_finished = outcome.code == 0;
  kills += outcome.code == -SIGKILL;
  resumed += outcome.err.find("goes on after step") != outcome.err.npos;
}

TEST_F(Resume, ARunKilledAtRandomMomentsWritesTheBytesOfOneNeverInterrupted) {
  const auto clock = [] { return std::chrono::steady_clock::now(); };
  const auto begin = clock();
  ASSERT_EQ(run(command("whole", "--save-steps 25 --test-steps 30")).code, 0);
  const double seconds = std::chrono::duration<double>(clock() - begin).count();
  const auto expected = contents_of(path("whole"));
  ASSERT_TRUE(expected.contains("results.json"));

  int kills = 0, runs = 0, resumed = 0;
  for (std::uint64_t draw = 0; kills < kKills; ++runs) {
    const std::string out = "killed_" + std::to_string(runs);
    const std::string again = command(out, "--save-steps 25 --test-steps 30 --resume auto");
    for (bool is_finished = false; !is_finished;) {
      const pid_t child = start(again);
      if (kills < kKills)
        kill_after(Random{kSeed, RandomStream::test}.uniform4(++draw).x * seconds, child);
      const Outcome outcome = wait_for(child);
      count(outcome, kills, resumed, is_finished);
      ASSERT_TRUE(is_finished || outcome.code == -SIGKILL) << outcome.err;
    }
    const auto actual = contents_of(path(out));
    for (const auto& [name, bytes] : expected) {
      ASSERT_TRUE(actual.contains(name)) << name;
      EXPECT_EQ(actual.at(name) == bytes, true) << name << " of " << out;
    }
    for (const auto& [name, bytes] : actual) EXPECT_TRUE(expected.contains(name)) << name;
    EXPECT_FALSE(fs::exists(path(out + ".bak-1")));
    fs::remove_all(path(out));
  }
  EXPECT_GT(resumed, 2);  // how many depends on the load
}

TEST_F(Resume, GpusThatAreNotThereAreRefused) {
  const std::string train = "train " + text("scene") + " -o " + text("gpu") + " --device cuda ";
  const Outcome many = run(train + "--set train.ranks=64");
  EXPECT_NE(many.code, 0);
  EXPECT_THAT(many.err, AnyOf(HasSubstr("--device cpu"), HasSubstr("set train.ranks=")));
  EXPECT_FALSE(fs::exists(path("gpu/checkpoints")));
}

TEST_F(Resume, AFolderThatIsBeingTrainedIntoIsRefused) {
  const std::string endless =
      "train " + text("scene") + " -o " + text("busy") + kResumable + " --iterations 1000000 ";
  const pid_t first = start(endless);
  while (newest_step(path("busy")) < 8 && ::waitpid(first, nullptr, WNOHANG) == 0)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  ASSERT_EQ(::waitpid(first, nullptr, WNOHANG), 0) << read_bytes(path("stderr.txt"));
  const std::string busy = text("busy");
  for (const std::string& second : {"train --resume " + busy + " --device cpu --threads 1",
                                    endless + "--resume auto", endless + "--force", endless}) {
    const Outcome refused = run(second);
    EXPECT_EQ(refused.code, 3) << refused.err;
    EXPECT_THAT(refused.err, AllOf(HasSubstr("another process"), HasSubstr(busy)));
  }
  EXPECT_FALSE(fs::exists(path("busy.bak-1")));
  ASSERT_EQ(::waitpid(first, nullptr, WNOHANG), 0);
  ::kill(first, SIGKILL);
  wait_for(first);
  const Outcome moved = run(command("busy", "--force"));
  EXPECT_EQ(moved.code, 0) << moved.err;
  EXPECT_TRUE(fs::exists(path("busy.bak-1")));
  EXPECT_FALSE(fs::exists(path("busy/.gemsplat.lock")));
}

TEST_F(Resume, ASignalSavesModelAndCheckpointAndTheRunGoesOnFromThere) {
  ASSERT_EQ(run(command("whole")).code, 0);
  for (const int signal : {SIGINT, SIGTERM}) {
    const std::string out = "stopped_" + std::to_string(signal);
    const Outcome stopped =
        run_and_signal(command(out, "--set train.iterations=60"), path(out), 12, signal);
    if (stopped.code == 0) GTEST_SKIP() << "the run was over before the signal came";
    EXPECT_EQ(stopped.code, 5) << stopped.err;
    EXPECT_THAT(stopped.err, AllOf(HasSubstr("stopped after step"), HasSubstr("--resume"),
                                   HasSubstr("gemsplat view " + text(out) + ")"),
                                   ::testing::Not(HasSubstr("error"))));
    EXPECT_FALSE(fs::exists(path(out) / "results.json"));
    EXPECT_TRUE(fs::exists(path(out) / "point_cloud"));
    const Outcome resumed = run("train --resume " + text(out) + " --device cpu --threads 1");
    ASSERT_EQ(resumed.code, 0) << resumed.err;
    const auto expected = contents_of(path("whole"));
    const auto actual = contents_of(path(out));
    for (const auto& [name, bytes] : expected) EXPECT_TRUE(actual.at(name) == bytes) << name;
  }
}

TEST_F(Resume, ADamagedCheckpointIsNamedAndTheOlderOneTaken) {
  ASSERT_EQ(run(command("whole")).code, 0);
  const Outcome killed = run_and_signal(command("out"), path("out"), 12, SIGKILL);
  if (killed.code == 0) GTEST_SKIP() << "the run was over before the kill";
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(path("out/checkpoints")))
    if (entry.path().extension() == ".ckpt") files.push_back(entry.path());
  ASSERT_GE(files.size(), 2u);
  const auto step = [](const fs::path& file) { return std::stoi(file.stem().string().substr(5)); };
  std::sort(files.begin(), files.end(),
            [&](const fs::path& a, const fs::path& b) { return step(a) > step(b); });
  std::string bytes = read_bytes(files[0]);
  bytes[bytes.size() / 3] ^= 1;
  write_bytes(files[0], bytes);
  const Outcome resumed = run(command("out", "--resume"));
  ASSERT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_THAT(resumed.err, AllOf(HasSubstr(files[0].string()), HasSubstr("damaged")));
  EXPECT_THAT(resumed.err, HasSubstr("after step " + std::to_string(step(files[1]))));
  const auto expected = contents_of(path("whole"));
  auto actual = contents_of(path("out"));
  for (const auto& [name, content] : expected) EXPECT_TRUE(actual.at(name) == content) << name;
}

TEST_F(Resume, AFinishedRunIsLeftAloneAndKeepsOneCheckpoint) {
  ASSERT_EQ(run(command("out", "--resume auto")).code, 0);  // nothing to resume
  EXPECT_EQ(newest_step(path("out")), kSteps);
  EXPECT_EQ(std::distance(fs::directory_iterator(path("out/checkpoints")), {}), 1);
  const auto before = contents_of(path("out"));
  const Outcome again = run(command("out", "--resume auto"));
  EXPECT_EQ(again.code, 0);
  EXPECT_THAT(again.err, HasSubstr("is finished"));
  EXPECT_EQ(contents_of(path("out")), before);
}

TEST_F(Resume, AFinishedRunIsExtendedAsIfItHadBeenLongerFromTheStart) {
  ASSERT_EQ(run(command("whole", "--set train.extra_steps=20")).code, 0);
  ASSERT_EQ(run(command("out")).code, 0);
  const std::string results = read_bytes(path("out/results.json"));
  const Outcome extended =
      run("train --resume " + text("out") + " --iterations +20 --device cpu --threads 1");
  ASSERT_EQ(extended.code, 0) << extended.err;
  EXPECT_EQ(read_bytes(path("out/results.json.bak-1")), results);
  for (const char* name :
       {"point_cloud/iteration_80/point_cloud.ply", "results.json", "per_view.json"})
    EXPECT_EQ(without_times(path("out") / name), without_times(path("whole") / name)) << name;
  EXPECT_TRUE(fs::exists(path("out/point_cloud/iteration_60/point_cloud.ply")));
  EXPECT_EQ(run("train --resume " + text("out") + " --iterations +5 --device cpu").code, 0);
  EXPECT_TRUE(fs::exists(path("out/point_cloud/iteration_85/point_cloud.ply")));
}

TEST_F(Resume, APresetOfAnotherLengthDoesNotChangeHowManyStepsAreAdded) {
  std::ofstream(path("long.toml")) << "[train]\niterations = 2500\n";
  ASSERT_EQ(run(command("out")).code, 0);
  const Outcome extended = run("train --resume " + text("out") + " -c " + text("long.toml") +
                               " --iterations +5 --device cpu");
  ASSERT_EQ(extended.code, 0) << extended.err;
  EXPECT_TRUE(fs::exists(path("out/point_cloud/iteration_65/point_cloud.ply")));
}

TEST_F(Resume, ACheckpointGoesOnInAnotherFolderToo) {
  ASSERT_EQ(run(command("whole")).code, 0);
  const Outcome killed = run_and_signal(command("out"), path("out"), 12, SIGKILL);
  if (killed.code == 0) GTEST_SKIP() << "the run was over before the kill";
  const auto before = contents_of(path("out"));
  const Outcome other =
      run("train --resume " + text("out") + " -o " + text("other") + " --device cpu --threads 1");
  ASSERT_EQ(other.code, 0) << other.err;
  EXPECT_EQ(contents_of(path("out")), before);
  EXPECT_EQ(contents_of(path("other")), contents_of(path("whole")));
}

TEST_F(Resume, SettingsThatARunKeepsAreNamedWhereTheyDiffer) {
  ASSERT_EQ(run_and_signal(command("out"), path("out"), 8, SIGKILL).code, -SIGKILL);
  const Outcome outcome =
      run(command("out", "--resume auto --seed 7 --set optimizer.sh0_lr=0.01 --threads 2"));
  EXPECT_EQ(outcome.code, 2);
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("train.seed = 42 (now 7)"),
                                 HasSubstr("optimizer.sh0_lr = 0.0025 (now 0.01)"),
                                 ::testing::Not(HasSubstr("train.threads"))));
  const Outcome added = run("train --resume " + text("out") + " --iterations +20");
  EXPECT_EQ(added.code, 2);
  EXPECT_THAT(added.err, HasSubstr("finish it"));
}

TEST_F(Resume, HalfMomentsGoOnAsTheyAre) {
  const std::string setting = "--set optimizer.moments=half ", out = "out_half";
  ASSERT_EQ(run(command("whole_half", setting)).code, 0);
  const auto expected = contents_of(path("whole_half"));
  ASSERT_EQ(run_and_signal(command(out, setting), path(out), 12, SIGKILL).code, -SIGKILL);
  const Outcome floats = run(command(out, "--resume auto --set optimizer.moments=float"));
  EXPECT_EQ(floats.code, 2);
  EXPECT_THAT(floats.err, AllOf(HasSubstr("optimizer.moments = \"half\" (now \"float\")"),
                                HasSubstr("start a new run in another folder")));
  const Outcome resumed = run(command(out, setting + "--resume auto"));
  ASSERT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_EQ(contents_of(path(out)), expected);
  const Outcome from = run(command("from_half", setting + "--from " + text(out)));
  EXPECT_EQ(from.code, 0) << from.err;
}

TEST_F(Resume, WhatCannotBeResumedIsAnErrorThatSaysWhy) {
  EXPECT_EQ(run("train --resume " + text("nowhere")).code, 2);
  write_bytes(path("empty/notes.txt"), "x");
  const Outcome empty = run("train --resume " + text("empty"));
  EXPECT_EQ(empty.code, 3);
  EXPECT_THAT(empty.err, HasSubstr("no checkpoint"));
  write_bytes(path("model.ply"), "ply\n");
  const Outcome model = run(command("out", "--resume " + text("model.ply")));
  EXPECT_EQ(model.code, 2);
  EXPECT_THAT(model.err, AllOf(HasSubstr("is a model, not a checkpoint"), HasSubstr("--from ")));
  EXPECT_EQ(run(command("out", "--iterations +10")).code, 2);
  EXPECT_EQ(run(command("out", "--resume auto --iterations +10")).code, 2);
  EXPECT_EQ(run(command("out", "--resume auto --iterations +1x")).code, 2);
  EXPECT_FALSE(fs::exists(path("out")));
}

TEST_F(Resume, ARunFromAModelIsNamedByARelativePathAndResumed) {
  ASSERT_EQ(run(command("first")).code, 0);
  const std::string model = "first/point_cloud/iteration_60/point_cloud.ply";
  const std::string from =
      command("out", "--start-from " + fs::relative(path(model)).string() + " --resume auto");
  const Outcome whole = run(command("whole", "--from " + text(model)));
  ASSERT_EQ(whole.code, 0) << whole.err;
  EXPECT_THAT(whole.err, HasSubstr("training starts from the"));
  const Outcome killed = run_and_signal(from, path("out"), 12, SIGKILL);
  if (killed.code == 0) GTEST_SKIP() << "the run was over before the kill";
  const Outcome resumed = run(from);
  ASSERT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_THAT(resumed.err, HasSubstr("goes on after step"));
  const auto expected = contents_of(path("whole")), actual = contents_of(path("out"));
  for (const auto& [name, bytes] : expected) EXPECT_TRUE(actual.at(name) == bytes) << name;
  EXPECT_THAT(read_bytes(path("out/config.toml")), HasSubstr("start_from = \"" + text(model)));
}

TEST_F(Resume, AnotherSceneIsRefused) {
  ASSERT_EQ(run_and_signal(command("out"), path("out"), 8, SIGKILL).code, -SIGKILL);
  fs::copy(path("scene"), path("other"), fs::copy_options::recursive);
  std::string images = read_bytes(path("other/sparse/0/images.txt"));
  images.replace(images.find("-0.1 "), 5, "-0.2 ");
  write_bytes(path("other/sparse/0/images.txt"), images);
  const Outcome moved = run("train " + text("other") + " --resume " + text("out"));
  EXPECT_EQ(moved.code, 3);
  EXPECT_THAT(moved.err, HasSubstr("the camera of view_1.png differs"));
  fs::remove_all(path("other"));
  fs::rename(path("scene"), path("other"));  // the same one in another place is fine
  EXPECT_EQ(run("train " + text("other") + " --device cpu --resume " + text("out")).code, 0);
}

}  // namespace
}  // namespace gs
