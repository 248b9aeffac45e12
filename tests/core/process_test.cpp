// SPDX-License-Identifier: Apache-2.0
// Child processes: their exit is reported, their output goes where it should, and they do not
// outlive the parent.
#include "gs_core/io/process.h"

#include <gmock/gmock.h>
#include <signal.h>

#include <thread>

#include "gs_core/error.h"
#include "gs_core/io/subprocess.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

using ::testing::HasSubstr;

TEST(StartChild, FindsTheProgramOnThePathAndTellsItsExitCode) {
  const ProcessEnd end = wait_for_child(start_child({"sh", "-c", "exit 3"}));
  EXPECT_EQ(end.exit_code, 3);
  EXPECT_EQ(end.signal, 0);
  EXPECT_FALSE(end.good());
}

TEST(StartChild, APathThatCannotRunIsAnErrorThatNamesIt) {
  try {
    start_child({"/no/such/program"});
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("cannot start /no/such/program: No such file"));
  }
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
  try {
    run_process({"sh", "-c", "echo ready; sleep 600"}, {}, [](std::string_view) { raise(SIGINT); });
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::interrupted);
  }
}

}  // namespace
}  // namespace gs
