// SPDX-License-Identifier: Apache-2.0
// Child processes: their exit is reported, their output goes where it should, and they do not
// outlive the parent.
#include "gs_core/system/processes/process.h"

#include <pthread.h>
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <thread>

#include "gs_core/system/processes/signals.h"
#include "gs_core/system/processes/subprocess.h"
#include "gs_core/system/sanitizers.h"
#include "tests/support/temp_folder.h"
#include "tests/support/test.h"

namespace gs {
namespace {

TEST(StartChild, FindsTheProgramOnThePathAndTellsItsExitCode) {
  const ProcessEnd end = wait_for_child(start_child({"sh", "-c", "exit 3"}));
  EXPECT_EQ(end.exit_code, 3);
  EXPECT_EQ(end.signal, 0);
  EXPECT_FALSE(end.good());
}

// As OpenBLAS does it, whose lock a child of a child would wait for without end.
TEST(StartChild, NoLibraryHoldsAForkUp) {
#if defined(GS_THREAD_SANITIZER) || !defined(__GLIBC__) || !__GLIBC_PREREQ(2, 34)
  GTEST_SKIP() << "there is no fork without handlers here";
#endif
  static int calls = 0;
  ASSERT_EQ(pthread_atfork([] { ++calls; }, nullptr, nullptr), 0);
  EXPECT_TRUE(wait_for_child(start_child({"true"})).good());
  EXPECT_EQ(calls, 0);
}

TEST(StartChild, NoArgumentIsParsedAsACommand) {
  const TempFolder folder;
  const auto log = folder.path() / "log";
  const std::string evil = "$(echo run) `echo run`; echo run | cat > " + log.string() + "; \n*'\"";
  wait_for_child(start_child({"printf", "%s", evil}, {.output = open_log(log)}));
  EXPECT_EQ(read_bytes(log), evil);
}

TEST(StartChild, APathThatCannotRunIsAnErrorThatNamesIt) {
  EXPECT_THAT(error_of([] { start_child({"/no/such/program"}); }),
              HasSubstr("cannot start /no/such/program: No such file"));
}

TEST(StartChild, OutputAndErrorsGoToTheEndOfTheLogAndInputIsEmpty) {
  const TempFolder folder;
  const auto log = folder.path() / "log";
  write_bytes(log, "before\n");
  wait_for_child(start_child({"sh", "-c", "cat; echo $WORD; echo err >&2"},
                             {.output = open_log(log), .variables = {"WORD=out"}}));
  EXPECT_EQ(read_bytes(log), "before\nout\nerr\n");
}

#ifdef __linux__
TEST(StartChild, AChildEndsWithTheThreadThatStartedIt) {
  pid_t child = 0;
  std::thread([&] { child = start_child({"sleep", "600"}); }).join();
  EXPECT_EQ(wait_for_child(child).signal, SIGTERM);
}
#endif

// Whether a process runs; one that has ended and was not waited for does not.
bool is_running(const std::string& process) {
  std::ifstream file("/proc/" + process + "/stat");
  std::string id, name, state;
  return file >> id >> name >> state && state != "Z";
}

// A program that starts another one, as a script in COLMAP's place does, is killed with it, whatever
// ends this program.
TEST(StartChild, NoProgramOfTheGroupOutlivesOurKill) {
  if (!std::filesystem::exists("/proc/self/stat")) GTEST_SKIP() << "there is no /proc";
  const TempFolder folder;
  const auto grandchild = folder.path() / "pid";
  const pid_t us = ::fork();
  if (us == 0) {
    start_child({"sh", "-c", "trap '' TERM; sleep 600 & echo $! > \"$0\"; wait; sleep 600",
                 grandchild.string()});
    ::pause();
    ::_exit(0);
  }
  while (read_bytes(grandchild).empty()) std::this_thread::yield();
  std::string process = read_bytes(grandchild);
  process.pop_back();
  EXPECT_TRUE(is_running(process));
  ::kill(us, SIGKILL);
  wait_for_child(us);
  const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(2);
  while (is_running(process) && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_FALSE(is_running(process));
}

TEST(RunProcess, ASignalOfAClosedTerminalEndsTheProgram) {
  EXPECT_THROW(run_process({"sh", "-c", "echo ready; sleep 600"}, {},
                           [](std::string_view) { raise(SIGHUP); }),
               Error);
}

TEST(LastWords, AreSaidAndTheSignalEndsTheProgramAllTheSame) {
  const auto end_with = [](int signal) {
    const LastWords words("nothing was trained\n");
    ::raise(signal);
  };
  EXPECT_EXIT(end_with(SIGINT), testing::KilledBySignal(SIGINT), "nothing was trained");
  EXPECT_EXIT(end_with(SIGTERM), testing::KilledBySignal(SIGTERM), "nothing was trained");
}

TEST(RunProcess, GivesEachLineAndTheWholeOutputToTheLog) {
  const TempFolder folder;
  std::vector<std::string> lines;
  const ProcessEnd end =
      run_process({"sh", "-c", "echo one; echo two; printf three"}, folder.path() / "log",
                  [&](std::string_view line) { lines.emplace_back(line); });
  EXPECT_TRUE(end.good());
  EXPECT_EQ(lines, (std::vector<std::string>{"one", "two", "three"}));
  EXPECT_EQ(read_bytes(folder.path() / "log"), "one\ntwo\nthree");
}

TEST(RunProcess, ASignalThatWeGetEndsTheProgramAndIsAnError) {
  EXPECT_THAT(
      [&] {
        run_process({"sh", "-c", "echo ready; sleep 600"}, {},
                    [](std::string_view) { raise(SIGINT); });
      },
      FailsWith(ExitCode::interrupted));
}

}  // namespace
}  // namespace gs
