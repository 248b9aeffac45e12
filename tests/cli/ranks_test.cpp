// SPDX-License-Identifier: Apache-2.0
// Runs whose ranks are processes: `gemsplat train` starts them, or finds itself among those of srun
// or mpirun. They write the bytes of one rank, and end together where one of them is killed.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <functional>
#include <thread>
#include <vector>

#include "gs_core/processes/peer_socket.h"
#include "gs_core/processes/process.h"
#include "gs_core/random.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr const char* kRanks = " --set train.ranks=3 --set train.batch=3";
constexpr const char* kProcesses =
    " --set train.ranks=3 --set train.batch=3 --set train.rank_processes=true";
// Hours, so that a test can do something in the middle of it.
constexpr const char* kLong = " --iterations 1000000 --checkpoint-every 20";

class Ranks : public Program {
 protected:
  void SetUp() override { write_scene(path("scene")); }
  std::string ply(const std::string& run) const {
    return read_bytes(path(run) / "point_cloud/iteration_20/point_cloud.ply");
  }

  // A program that runs beside the test, with its messages in a file.
  pid_t start(const std::vector<std::string>& arguments, const std::string& log,
              const std::vector<std::string>& variables = {}) {
    const Descriptor output = open_log(path(log));
    ChildOptions options;
    options.output = output;
    options.variables = variables;
    return start_child(arguments, options);
  }
  std::vector<std::string> words_of_train(const std::string& run, const std::string& more) const {
    std::vector<std::string> words = {GS_PROGRAM, "train", text("scene"), "-o", text(run)};
    std::istringstream rest(kTrain + more);
    for (std::string word; rest >> word;) words.push_back(word);
    return words;
  }
  static bool comes(const std::function<bool()>& what, int seconds = 60) {
    for (int i = 0; i < 20 * seconds; ++i) {
      if (what()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    return false;
  }
  bool has_checkpoint(const std::string& run) const {
    return fs::exists(path(run) / "checkpoints") && !fs::is_empty(path(run) / "checkpoints");
  }
  // The processes that a program has started as ranks.
  static std::vector<pid_t> ranks_of(pid_t leader) {
    std::vector<pid_t> ranks;
    for (const auto& entry : fs::directory_iterator("/proc")) {
      const std::string name = entry.path().filename().string();
      if (name.find_first_not_of("0123456789") != name.npos) continue;
      std::ifstream status(entry.path() / "status");
      for (std::string line; std::getline(status, line);)
        if (line == "PPid:\t" + std::to_string(leader)) ranks.push_back(pid_t(std::stol(name)));
    }
    return ranks;
  }
  // Trains with three processes, does something to one of them, and returns what the program says.
  std::string error_after(const std::string& run, const std::function<void(pid_t)>& what,
                          const std::string& more = "") {
    const pid_t leader =
        start(words_of_train(run, std::string(kProcesses) + kLong + more), run + ".log");
    EXPECT_TRUE(comes([&] { return has_checkpoint(run); })) << read_bytes(path(run + ".log"));
    const std::vector<pid_t> ranks = ranks_of(leader);
    EXPECT_EQ(ranks.size(), 2u);
    if (!ranks.empty()) what(ranks.front());
    const auto begin = std::chrono::steady_clock::now();
    const ProcessEnd end = wait_for_child(leader);
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));
    EXPECT_EQ(end.exit_code, 3);
    for (const pid_t rank : ranks) EXPECT_NE(::kill(rank, 0), 0) << "a rank still runs";
    std::string log = read_bytes(path(run + ".log"));
    return log.substr(std::min(log.find("error:"), log.size()));
  }
};

TEST_F(Ranks, AsProcessesWriteTheBytesOfThreads) {
  ASSERT_EQ(train("one", " --set train.batch=3").code, 0);
  ASSERT_EQ(train("threads", kRanks).code, 0);
  const Outcome processes = train("processes", kProcesses);
  ASSERT_EQ(processes.code, 0) << processes.err;
  EXPECT_EQ(ply("threads"), ply("one"));
  EXPECT_EQ(ply("processes"), ply("one"));
  EXPECT_THAT(processes.err, HasSubstr("training on cpu (3 ranks)"));
}

TEST_F(Ranks, OnGpusAreAskedForByOneFlag) {
  const Outcome shown = run("train --gpus 3 --print-config");
  EXPECT_THAT(shown.out, AllOf(HasSubstr("ranks = 3"), HasSubstr("batch = 3"),
                               HasSubstr("device = \"cuda\"")));
  const Outcome refused = run("train --gpus some --print-config");
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("--gpus some"));
}

TEST_F(Ranks, EndTogetherWhereOneIsKilled) {
  const std::string error = error_after("killed", [](pid_t rank) { ::kill(rank, SIGKILL); });
  EXPECT_THAT(error,
              AllOf(HasSubstr("error: rank "),
                    HasSubstr(": its process was ended by signal 9 (Killed), so the run ends"),
                    HasSubstr("the checkpoint of step ")));
  EXPECT_EQ(std::count(error.begin(), error.end(), '\n'), 1) << error;
}

TEST_F(Ranks, EndTogetherWhereOneHangs) {
  const std::string error = error_after(
      "hung", [](pid_t rank) { ::kill(rank, SIGSTOP); }, " --set train.rank_deadline=4");
  EXPECT_THAT(error, AllOf(HasSubstr("error: rank "), HasSubstr(": no sign of life for 4 s")));
}

TEST_F(Ranks, StopWithTheirRun) {
  const pid_t leader =
      start(words_of_train("stopped", std::string(kProcesses) + kLong), "stopped.log");
  ASSERT_TRUE(comes([&] { return has_checkpoint("stopped"); }));
  const std::vector<pid_t> ranks = ranks_of(leader);
  for (const pid_t rank : ranks) ::kill(rank, SIGINT);  // as the terminal or Slurm may do
  ::kill(leader, SIGINT);
  EXPECT_EQ(wait_for_child(leader).exit_code, 5);
  EXPECT_THAT(read_bytes(path("stopped.log")), HasSubstr("stopped after step "));
  for (const pid_t rank : ranks) EXPECT_NE(::kill(rank, 0), 0) << "a rank still runs";
}

// Each time one of the processes is killed, rank 0 among them, and another number of ranks goes on.
TEST_F(Ranks, KilledAtRandomMomentsEndInTheBytesOfOneRank) {
  constexpr int kKills = 20;
  const std::string settings =
      " --set train.batch=2 --iterations 400 --checkpoint-every 4 --set density.from_step=10 --set "
      "density.every=10 --set density.gradient_threshold=1e-5";
  const std::string last = "/point_cloud/iteration_400/point_cloud.ply";
  ASSERT_EQ(train("one", settings).code, 0);
  const Random random{5, RandomStream::test};
  int kills = 0;
  for (std::uint64_t attempt = 0; kills < kKills && !fs::exists(text("killed") + last); ++attempt) {
    const Vec4f draw = random.uniform4(attempt);
    const pid_t leader =
        start(words_of_train("killed", settings +
                                           " --resume auto --set train.rank_processes=true "
                                           "--set train.ranks=" +
                                           std::to_string(2 + int(3 * draw.x))),
              "killed.log");
    std::this_thread::sleep_for(std::chrono::duration<double>(0.3 + 0.7 * double(draw.y)));
    std::vector<pid_t> all = ranks_of(leader);
    all.push_back(leader);
    kills += ::kill(all[std::size_t(draw.z * float(all.size()))], SIGKILL) == 0;
    wait_for_child(leader);
  }
  EXPECT_GE(kills, kKills / 2);
  const Outcome rest = train("killed", settings + " --resume auto");
  ASSERT_EQ(rest.code, 0) << rest.err;
  EXPECT_EQ(read_bytes(text("killed") + last), read_bytes(text("one") + last));
}

// With the program of two GPUs and NCCL. scripts/try_gpu_processes.sh tries more on such a machine.
TEST_F(Ranks, OnGpusAsProcessesWriteTheBytesOfOneGpu) {
  const auto train_on = [&](const std::string& name, const std::string& more) {
    return run("train " + text("scene") + " -o " + text(name) +
               " --deterministic --iterations 20 --set train.batch=2 " + more);
  };
  const Outcome processes =
      train_on("processes", "--gpus 2 --set train.rank_processes=true --set train.log_every=5");
  for (const char* const lack : {"--device cpu", "needs the GPU", "GEMSPLAT_NCCL"})
    if (processes.err.find(lack) != processes.err.npos) GTEST_SKIP() << processes.err;
  ASSERT_EQ(processes.code, 0) << processes.err;
  ASSERT_EQ(train_on("one", "--device cuda").code, 0);
  ASSERT_EQ(train_on("threads", "--gpus 2").code, 0);
  EXPECT_EQ(ply("threads"), ply("one"));
  EXPECT_EQ(ply("processes"), ply("one"));
}

// ---- started by others -------------------------------------------------------------------------

TEST_F(Ranks, MeetWhereSrunStartsThem) {
  ASSERT_EQ(train("one", " --set train.batch=3").code, 0);
  const auto variables = [](int rank) {
    return std::vector<std::string>{"SLURM_PROCID=" + std::to_string(rank), "SLURM_NTASKS=3",
                                    "SLURM_STEP_NUM_TASKS=3", "SLURM_JOB_ID=17", "SLURM_STEP_ID=0"};
  };
  const fs::path before = fs::current_path();
  fs::current_path(path(""));
  std::vector<pid_t> tasks;
  for (const int rank : {2, 0, 1})
    tasks.push_back(
        start(words_of_train("srun", " --set train.batch=3"), "srun.log", variables(rank)));
  for (const pid_t task : tasks)
    EXPECT_EQ(wait_for_child(task).exit_code, 0) << read_bytes(path("srun.log"));
  fs::current_path(before);
  EXPECT_EQ(ply("srun"), ply("one"));
  EXPECT_FALSE(fs::exists(path(".gemsplat-ranks-slurm-17.0")));
}

TEST_F(Ranks, OfABatchScriptAreNone) {
  const Outcome alone = train("alone", "");
  const Outcome in_script = run("train " + text("scene") + " -o " + text("script") + kTrain,
                                "SLURM_PROCID=0 SLURM_NTASKS=4 SLURM_JOB_ID=17 ");
  EXPECT_EQ(in_script.code, 0) << in_script.err;
  EXPECT_EQ(ply("script"), ply("alone"));
}

TEST_F(Ranks, StrangersAtThePortAreNotTaken) {
  const auto variables = [](int rank) {
    return std::vector<std::string>{"OMPI_COMM_WORLD_RANK=" + std::to_string(rank),
                                    "OMPI_COMM_WORLD_SIZE=2", "PMIX_NAMESPACE=job@5"};
  };
  const fs::path before = fs::current_path();
  fs::current_path(path(""));
  const pid_t leader =
      start(words_of_train("mpi", " --set train.batch=2"), "mpi.log", variables(0));
  const fs::path meeting = path(".gemsplat-ranks-mpi-job_5");
  ASSERT_TRUE(comes([&] { return fs::exists(meeting); }));
  EXPECT_EQ(fs::status(meeting).permissions(), fs::perms::owner_read | fs::perms::owner_write);
  std::string host, nonce;
  int port = 0;
  std::ifstream(meeting) >> host >> port >> nonce;
  PeerSocket stranger = connect_to_peer("127.0.0.1", port, PeerSocket::Seconds(10));
  stranger.send(0, std::vector<std::byte>(100), PeerSocket::Seconds(10));
  EXPECT_THROW(stranger.receive(PeerSocket::Seconds(10)), PeerLost);
  const pid_t other = start(words_of_train("mpi", " --set train.batch=2"), "mpi.log", variables(1));
  EXPECT_EQ(wait_for_child(other).exit_code, 0);
  EXPECT_EQ(wait_for_child(leader).exit_code, 0) << read_bytes(path("mpi.log"));
  fs::current_path(before);
}

TEST_F(Ranks, OfNoRunAreRefused) {
  const Outcome alone = run("rank");
  EXPECT_EQ(alone.code, 2);
  EXPECT_THAT(alone.err, HasSubstr("gemsplat train starts this by itself"));
  const Outcome odd = train("odd", "");
  EXPECT_EQ(odd.code, 0);
  const Outcome bad =
      run("train " + text("scene") + " -o " + text("bad") + kTrain, "PMI_RANK=7 PMI_SIZE=2 ");
  EXPECT_EQ(bad.code, 2);
  EXPECT_THAT(bad.err, HasSubstr("rank 7 (PMI_RANK) of 2 (PMI_SIZE)"));
}

}  // namespace
}  // namespace gs
