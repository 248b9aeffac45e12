// SPDX-License-Identifier: Apache-2.0
// gemsplat experiment: its tables are complete whatever is killed or fails in between, and no run
// is done twice.
#include <gmock/gmock.h>
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <functional>
#include <optional>
#include <thread>

#include "gs_core/system/text/json.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr std::chrono::seconds kPatience{120};  // a machine may be busy

void wait_until(const std::function<bool()>& holds) {
  const auto end = std::chrono::steady_clock::now() + kPatience;
  while (!holds()) {
    ASSERT_LT(std::chrono::steady_clock::now(), end) << "waited too long";
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

// The process whose parent is `parent`, if there is one.
std::optional<pid_t> child_of(pid_t parent) {
  for (const auto& entry : fs::directory_iterator("/proc")) {
    std::ifstream file(entry.path() / "stat");
    int process = 0, its_parent = 0;
    std::string name, state;
    if (file >> process >> name >> state >> its_parent && its_parent == parent && state != "Z")
      return process;
  }
  return std::nullopt;
}

// Whether a process runs; a zombie does not.
bool is_running(pid_t process) {
  std::ifstream file("/proc/" + std::to_string(process) + "/stat");
  std::string id, name, state;
  return file >> id >> name >> state && state != "Z";
}

int count_of(const std::string& text, const std::string& part) {
  int count = 0;
  for (std::size_t at = 0; (at = text.find(part, at)) != text.npos; at += part.size()) ++count;
  return count;
}

class Experiment : public Program {
 protected:
  // 2 scenes x 2 configs x 2 seeds; `more` is written before the configs.
  void write_experiment(int iterations, const std::string& more = "") {
    for (const char* scene : {"scene_a", "scene_b"})
      if (!fs::exists(path(scene))) write_scene(path(scene));
    write_bytes(path("e.toml"),
                "output = 'out'\n"
                "scenes = ['scene_a', {path = 'scene_b/', name = 'b'}]\n"
                "seeds = [1, 2]\n" +
                    more +
                    "[set]\n"
                    "train = {iterations = " +
                    std::to_string(iterations) +
                    ", device = 'cpu', threads = 1, log_every = 5}\n"
                    "dataset = {eval = true, test_every = 3}\n"
                    "[[configs]]\nname = 'plain'\n"
                    "[[configs]]\nname = 'flat'\nset = {\"model.sh_degree\" = 0}\n");
  }
  Outcome experiment(const std::string& more = "") {
    return run("experiment " + text("e.toml") + " " + more);
  }
  // Starts the experiment as a process of its own.
  pid_t start_experiment() {
    const std::string file = text("e.toml"), log = text("background.txt");
    const pid_t process = ::fork();
    if (process == 0) {
      if (!std::freopen(log.c_str(), "w", stdout) || !std::freopen(log.c_str(), "a", stderr))
        ::_exit(1);
      ::execl(GS_PROGRAM, GS_PROGRAM, "experiment", file.c_str(), nullptr);
      ::_exit(1);
    }
    return process;
  }
  static int wait_for(pid_t process) {
    int status = 0;
    ::waitpid(process, &status, 0);
    return status;
  }
  void expect_complete_tables() {
    const SortedJson results = json("out/results.json");
    ASSERT_EQ(results.at("runs").size(), 8u);
    for (const auto& run : results.at("runs")) EXPECT_EQ(run.at("state"), "finished") << run;
    ASSERT_EQ(results.at("summary").size(), 4u);
    for (const auto& group : results.at("summary")) {
      EXPECT_EQ(group.at("finished"), 2);
      for (const char* key :
           {"psnr", "ssim", "flip", "num_gaussians", "train_seconds", "peak_host_bytes"})
        EXPECT_TRUE(group.at(key).at("standard_deviation").is_number()) << key;
    }
    const std::string csv = read_bytes(path("out/results.csv"));
    EXPECT_EQ(count_of(csv, "\n"), 9);
    EXPECT_EQ(count_of(csv, ",finished,"), 8);
    EXPECT_THAT(read_bytes(path("out/results.md")),
                AllOf(HasSubstr("8 of 8 runs are finished"), HasSubstr(" ± ")));
  }
};

TEST_F(Experiment, TablesHaveEveryRunMeansOverSeedsAndProvenance) {
  write_experiment(10);
  const Outcome outcome = experiment();
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("8 of 8 runs finished"));
  if (fs::exists(path("out/report.html"))) {
    EXPECT_THAT(outcome.out, HasSubstr("report: " + path("out/report.html").string()));
  }
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("[8/8] b/flat/seed2: psnr "), HasSubstr("train.log")));
  expect_complete_tables();

  const SortedJson results = json("out/results.json");
  const SortedJson& run = results.at("runs").at(2);
  EXPECT_EQ(run.at("scene"), "scene_a");
  EXPECT_EQ(run.at("config"), "flat");
  EXPECT_EQ(run.at("seed"), 1);
  EXPECT_EQ(run.at("settings").at("model.sh_degree"), 0);
  EXPECT_EQ(run.at("results"), json("out/scene_a/flat/seed1/results.json"));
  for (const char* key : {"version", "commit", "cpu", "device", "scene_hash", "date"})
    EXPECT_TRUE(run.at("results").contains(key)) << key;
  const double first = results["runs"][2]["results"]["test"]["psnr"];
  const double second = results["runs"][3]["results"]["test"]["psnr"];
  const SortedJson& psnr = results.at("summary").at(1).at("psnr");
  EXPECT_NEAR(psnr.at("mean"), (first + second) / 2, 1e-9);
  EXPECT_NEAR(psnr.at("standard_deviation"), std::abs(first - second) / std::sqrt(2), 1e-9);
}

TEST_F(Experiment, FinishedRunsAreNotRepeatedUnlessTheirSettingsChange) {
  write_experiment(5);
  ASSERT_EQ(experiment("-q").code, 0);
  const auto written = fs::last_write_time(path("out/b/plain/seed1/results.json"));
  const Outcome again = experiment();
  EXPECT_EQ(again.code, 0);
  EXPECT_THAT(again.err, HasSubstr("8 runs, 8 finished already"));
  EXPECT_EQ(fs::last_write_time(path("out/b/plain/seed1/results.json")), written);

  std::string file = read_bytes(path("e.toml"));
  file.replace(file.find("log_every = 5"), 13, "log_every = 2");  // changes no result
  write_bytes(path("e.toml"), file);
  const Outcome logged = experiment();
  EXPECT_EQ(logged.code, 0);
  EXPECT_THAT(logged.err, HasSubstr("8 runs, 8 finished already"));

  file.replace(file.find("sh_degree\" = 0"), 14, "sh_degree\" = 1");
  write_bytes(path("e.toml"), file);
  const Outcome changed = experiment();
  EXPECT_EQ(changed.code, 0) << changed.err;
  EXPECT_THAT(changed.err, HasSubstr("8 runs, 4 finished already"));
  EXPECT_TRUE(fs::exists(path("out/b/flat/seed1.bak-1/results.json")));  // nothing is lost
  EXPECT_EQ(fs::last_write_time(path("out/b/plain/seed1/results.json")), written);
  expect_complete_tables();
}

TEST_F(Experiment, WithoutATerminalItSaysHowFarTheRunsAre) {
  write_experiment(150);
  const Outcome outcome = experiment("--jobs 2 --status-every 0.001");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.err,
              ContainsRegex("0 of 8 runs done; .*scene_a/plain/seed1 at step "
                            "[0-9]+ of 150, scene_a/plain/seed2 at step [0-9]+ of 150"));
}

TEST_F(Experiment, SurvivesKill9OfAChild) {
  write_experiment(150);
  const pid_t parent = start_experiment();
  wait_until([&] { return fs::exists(path("out/scene_a/plain/seed2/config.toml")); });
  const auto child = child_of(parent);
  ASSERT_TRUE(child);
  ::kill(*child, SIGKILL);
  EXPECT_EQ(WEXITSTATUS(wait_for(parent)), 3);
  const std::string log = read_bytes(path("background.txt"));
  EXPECT_THAT(log, AllOf(HasSubstr("killed by signal 9"), HasSubstr("train.log"),
                         HasSubstr("7 of 8 runs finished")));
  EXPECT_EQ(count_of(read_bytes(path("out/results.csv")), ",failed,"), 1);

  const Outcome again = experiment();
  EXPECT_EQ(again.code, 0) << again.err;
  EXPECT_THAT(again.err, HasSubstr("7 finished already"));
  expect_complete_tables();
}

TEST_F(Experiment, ARunKilledBeforeItsFirstCheckpointIsTrainedOnceMoreWithFewerThreads) {
  write_experiment(5);
  ASSERT_EQ(experiment("-q").code, 0);
  for (const char* saved : {"results.json", "checkpoints", "point_cloud"})
    fs::remove_all(path("out/b/plain/seed1") / saved);
  std::string file = read_bytes(path("e.toml"));
  file.replace(file.find("threads = 1"), 11, "threads = 2");  // changes no result
  write_bytes(path("e.toml"), file);
  const Outcome again = experiment();
  EXPECT_EQ(again.code, 0) << again.err;
  EXPECT_THAT(again.err, AllOf(HasSubstr("8 runs, 7 finished already"), Not(HasSubstr("FAILED"))));
  EXPECT_FALSE(fs::exists(path("out/b/plain/seed1.bak-1")));
  // Killed after a model of train.save_steps, and before a checkpoint.
  for (const char* saved : {"results.json", "checkpoints"})
    fs::remove_all(path("out/b/plain/seed1") / saved);
  const Outcome after_a_model = experiment();
  EXPECT_EQ(after_a_model.code, 0) << after_a_model.err;
  EXPECT_TRUE(fs::exists(path("out/b/plain/seed1.bak-1/point_cloud")));
  EXPECT_THAT(experiment().err, HasSubstr("8 runs, 8 finished already"));
}

TEST_F(Experiment, SurvivesKill9OfTheParent) {
  write_experiment(150);
  const pid_t parent = start_experiment();
  wait_until([&] { return fs::exists(path("out/scene_a/flat/seed1/config.toml")); });
  const auto child = child_of(parent);
  ASSERT_TRUE(child);
  ::kill(parent, SIGKILL);
  wait_for(parent);
  const Outcome again = experiment();  // waits for the orphan, which ends by itself
  EXPECT_FALSE(is_running(*child));
  EXPECT_EQ(again.code, 0) << again.err;
  EXPECT_THAT(again.err, HasSubstr("2 finished already"));
  expect_complete_tables();
}

TEST_F(Experiment, AFailingRunDoesNotStopTheOthers) {
  write_experiment(5);
  fs::remove(path("scene_a/sparse/0/images.txt"));
  const Outcome outcome = experiment("--jobs 2");
  EXPECT_EQ(outcome.code, 3);
  EXPECT_THAT(outcome.out, HasSubstr("4 of 8 runs finished"));
  EXPECT_THAT(outcome.err,
              AllOf(HasSubstr("4 of the runs failed"), HasSubstr("scene_a/flat/seed2: exit code 3"),
                    HasSubstr(text("out/scene_a/flat/seed2/train.log"))));
  EXPECT_THAT(read_bytes(path("out/scene_a/flat/seed2/train.log")), HasSubstr("error: "));
  EXPECT_EQ(json("out/results.json").at("runs").at(0).at("state"), "failed");
}

TEST_F(Experiment, ASignalEndsTheRunsAndSaysHowToGoOn) {
  write_experiment(100000);
  const pid_t parent = start_experiment();
  wait_until([&] { return fs::exists(path("out/scene_a/plain/seed1/config.toml")); });
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  ::kill(parent, SIGINT);
  EXPECT_EQ(WEXITSTATUS(wait_for(parent)), 5);
  EXPECT_THAT(read_bytes(path("background.txt")),
              AllOf(HasSubstr("scene_a/plain/seed1 was stopped"), HasSubstr("goes on"),
                    Not(HasSubstr("FAILED"))));
  EXPECT_FALSE(fs::exists(path("out/scene_a/plain/seed2")));
}

TEST_F(Experiment, TwoOnOneOutputAreRefused) {
  write_experiment(100000);
  const pid_t first = start_experiment();
  wait_until([&] { return fs::exists(path("out/scene_a/plain/seed1/config.toml")); });
  const Outcome second = experiment();
  EXPECT_EQ(second.code, 3);
  EXPECT_THAT(second.err, AllOf(HasSubstr(std::to_string(first)), HasSubstr("is working on")));
  ::kill(first, SIGINT);
  wait_for(first);
}

TEST_F(Experiment, SlurmScriptHasATaskForEachRunAndGatherCollectsThem) {
  write_experiment(5, "slurm = {partition = 'gpu', gres = 'gpu:1', time = '02:00:00'}\n");
  const Outcome dry = experiment("--slurm --dry-run");
  ASSERT_EQ(dry.code, 0) << dry.err;
  EXPECT_THAT(dry.out,
              AllOf(HasSubstr("sbatch " + text("out/experiment.sbatch")), HasSubstr("--gather")));
  const std::string script = read_bytes(path("out/experiment.sbatch"));
  EXPECT_TRUE(script.starts_with("#!/bin/bash\n#SBATCH "));
  EXPECT_THAT(
      script,
      AllOf(HasSubstr("#SBATCH --array=0-7\n"), HasSubstr("#SBATCH --gres=gpu:1\n"),
            HasSubstr("#SBATCH --partition=gpu\n"), HasSubstr("#SBATCH --time=02:00:00\n"),
            HasSubstr("experiment " + text("e.toml") + " --only \"$SLURM_ARRAY_TASK_ID\"\n")));

  // A task, started as Slurm starts it.
  const std::string task =
      "SLURM_ARRAY_TASK_ID=3 bash " + text("out/experiment.sbatch") + " 2>" + text("task.txt");
  EXPECT_EQ(std::system(task.c_str()), 0) << read_bytes(path("task.txt"));
  EXPECT_TRUE(fs::exists(path("out/scene_a/flat/seed2/results.json")));
  EXPECT_FALSE(fs::exists(path("out/results.md")));
  experiment("--slurm --dry-run");
  EXPECT_THAT(read_bytes(path("out/experiment.sbatch")), HasSubstr("--array=0-2,4-7\n"));

  const Outcome some = experiment("--gather");
  EXPECT_EQ(some.code, 3);
  EXPECT_THAT(some.err,
              AllOf(HasSubstr("scene_a/flat/seed1"), Not(HasSubstr("scene_a/flat/seed2"))));
  for (const char* index : {"0", "1", "2", "4", "5", "6", "7"})
    ASSERT_EQ(experiment("-q --only " + std::string(index)).code, 0);
  EXPECT_EQ(experiment("--only 8").code, 2);
  EXPECT_EQ(experiment("--gather").code, 0);
  expect_complete_tables();
}

TEST_F(Experiment, SlurmScriptAsksForTheGpusOfARun) {
  write_experiment(5, "slurm = {partition = 'gpu'}\n");
  ASSERT_EQ(experiment("--slurm --dry-run --gpus-per-run 2").code, 0);
  EXPECT_THAT(read_bytes(path("out/experiment.sbatch")),
              AllOf(HasSubstr("#SBATCH --gres=gpu:2\n"), HasSubstr(" --gpus-per-run 2 --only ")));
  write_experiment(5, "slurm = {gpus-per-task = '2'}\n");
  ASSERT_EQ(experiment("--slurm --dry-run --gpus-per-run 2").code, 0);
  EXPECT_THAT(read_bytes(path("out/experiment.sbatch")),
              AllOf(HasSubstr("#SBATCH --gpus-per-task=2\n"), Not(HasSubstr("--gres"))));
}

TEST_F(Experiment, AnOptionOfSbatchThatIsNoOptionIsRefused) {
  write_experiment(5, "slurm = {comment = '" + std::string(1500, 'x') + "'}\n");
  const Outcome outcome = experiment("--slurm --dry-run");
  EXPECT_EQ(outcome.code, 2);
  EXPECT_THAT(outcome.err,
              AllOf(HasSubstr("e.toml"), HasSubstr("1000 bytes at most"), HasSubstr("1510")));
  EXPECT_FALSE(fs::exists(path("out/experiment.sbatch")));
}

TEST_F(Experiment, ANameThatIsNotUtf8IsRefused) {
  write_experiment(5);
  fs::rename(path("e.toml"), path("\xff.toml"));
  const Outcome outcome = run("experiment " + text("\xff.toml") + " --dry-run");
  EXPECT_EQ(outcome.code, 2);
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("is not UTF-8"), HasSubstr("rename")));
}

TEST_F(Experiment, WithoutSbatchTheSlurmCommandSaysWhatToDo) {
  write_experiment(5);
  const Outcome outcome = run("experiment " + text("e.toml") + " --slurm", "PATH=/nowhere ");
  EXPECT_EQ(outcome.code, 3);
  EXPECT_THAT(outcome.err, HasSubstr("no sbatch on the PATH"));
}

TEST_F(Experiment, AGridIsUnrolledAndPresetsAreTakenByName) {
  write_scene(path("scene_a"));
  write_bytes(path("e.toml"),
              "scenes = ['scene_a']\nconfigs = ['fast', {base = 'fast', name = 'g',"
              " grid = {loss.lambda_dssim = [0.1, 0.3], density.max_gaussians = [10, 20]}}]\n");
  const Outcome outcome = experiment("--dry-run");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(count_of(outcome.out, "to do"), 5);
  EXPECT_THAT(outcome.out,
              AllOf(HasSubstr("0 to do      scene_a/fast/seed42"),
                    HasSubstr("4 to do      scene_a/g+max_gaussians=20+lambda_dssim=0.3/"
                              "seed42")));
}

TEST_F(Experiment, MistakesNameFileLineAndTheNearestKey) {
  write_scene(path("scene_a"));
  const auto refusal = [&](const std::string& text) {
    write_bytes(path("e.toml"), text);
    const Outcome outcome = experiment("--dry-run");
    EXPECT_NE(outcome.code, 0) << text;
    return outcome.err;
  };
  EXPECT_THAT(refusal("scenes = ['scene_a']\nseed = [1]\n"),
              AllOf(HasSubstr("e.toml:2: "), HasSubstr("did you mean seeds?")));
  EXPECT_THAT(refusal("scenes = ['scene_c']\n"),
              AllOf(HasSubstr("e.toml:1: "), HasSubstr(text("scene_c"))));
  EXPECT_THAT(refusal("scenes = ['scene_a']\n[set.train]\n\nsed = 1\n"),
              AllOf(HasSubstr("e.toml:4: "), HasSubstr("did you mean train.seed?")));
  EXPECT_THAT(refusal("scenes = ['scene_a']\nset = {model.sh_degree = 4}\n"),
              AllOf(HasSubstr("e.toml:2: "), HasSubstr("from 0 to 3")));
  EXPECT_THAT(refusal("scenes = ['scene_a']\nconfigs = ['fsat']\n"),
              HasSubstr("did you mean the preset fast?"));
  EXPECT_THAT(refusal("scenes = ['scene_a', 'scene_a']\n"), HasSubstr("have the name scene_a"));
  EXPECT_THAT(refusal("seeds = [1]\n"), HasSubstr("names no scene"));
  EXPECT_THAT(refusal("scenes = ['scene_a']\nseeds = [-1]\n"), HasSubstr("e.toml:2: "));
}

}  // namespace
}  // namespace gs
