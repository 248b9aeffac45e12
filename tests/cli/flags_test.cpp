// SPDX-License-Identifier: Apache-2.0
// Flags of other trainers, as their users type them.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <unistd.h>

#include <algorithm>

#include "tests/support/program.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class Flags : public Program {};

TEST_F(Flags, OfOtherTrainersWithTheSameMeaningAreAcceptedAndHidden) {
  const Outcome outcome =
      run("train --print-config --data_dir a --result_dir b --data_factor 4 --lambda_dssim 0.3");
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("source = \"a\""), HasSubstr("output = \"b\""),
                                 HasSubstr("resolution = 4"), HasSubstr("lambda_dssim = 0.3")));
  EXPECT_THAT(run("train --help-all").out, Not(HasSubstr("--data-dir")));
}

TEST_F(Flags, OfOtherTrainersWithAnotherMeaningAreAnsweredWithTheFlagHere) {
  const std::pair<const char*, const char*> answers[] = {
      {"--checkpoint_iterations 7", "here that is --checkpoint-every"},
      {"--start_checkpoint a.pth", "here that is --resume"},
      {"--port=6009", "here that is --viewer --viewer-port"},
      {"--densify_until_iter 15000", "here that is --set density.until_step="},
      {"--densify_grad_threshold=1e-4", "here that is --set density.gradient_threshold="}};
  for (const auto& [theirs, here] : answers) {
    const Outcome outcome = run(std::string("train scene -o out ") + theirs);
    EXPECT_EQ(outcome.code, 2) << theirs;
    EXPECT_THAT(outcome.err, HasSubstr(here)) << theirs;
  }
}

TEST_F(Flags, OfEarlierVersionsAreAnsweredWithWhatTookTheirPlace) {
  const Outcome outcome = run("export model.ply out --lod");
  EXPECT_EQ(outcome.code, 2);
  EXPECT_THAT(outcome.err, HasSubstr("an output that ends in .rad"));
}

TEST_F(Flags, TheModelOfEvalAndRenderMayBeNamedByItsFlag) {
  for (const std::string flags : {"eval --json -m ", "eval --model_path=", "render -o x -m ",
                                  "render -o x --write color --model-path "}) {
    const Outcome outcome = run(flags + text("nowhere"));
    EXPECT_EQ(outcome.code, 3) << flags << outcome.err;  // the flag was read: it looks for the file
    EXPECT_THAT(outcome.err, HasSubstr(text("nowhere"))) << flags;
  }
}

TEST_F(Flags, HelpOfAVerbAndAShortVersionAreUnderstood) {
  EXPECT_EQ(run("help train").out, run("train --help").out);
  EXPECT_EQ(run("help").out, run("--help").out);
  EXPECT_EQ(run("-V").out, run("--version").out);
  EXPECT_EQ(run("help train").code, 0);
}

TEST_F(Flags, AResolutionOfAnotherTrainerIsAnsweredWithWhatIsPossible) {
  const Outcome third = run("train --print-config -r 3");
  EXPECT_EQ(third.code, 2);
  EXPECT_THAT(third.err,
              AllOf(HasSubstr("dataset.resolution = 3"), HasSubstr("0, 1, 2, 4, 8, or from 16")));
  EXPECT_EQ(run("train --print-config --set dataset.resolution=3").err, third.err)
      << "flags have no limits of their own";
  const Outcome automatic = run("train --print-config -r -1");
  EXPECT_EQ(automatic.code, 2);
  EXPECT_THAT(automatic.err, HasSubstr("here that is no -r"));
}

// What the program writes to standard error if that is a terminal.
std::string on_a_terminal(const std::string& before) {
  const int terminal = ::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
  ::grantpt(terminal);
  ::unlockpt(terminal);
  const std::string name = ::ptsname(terminal);
  const int kept_open = ::open(name.c_str(), O_RDWR | O_NOCTTY);  // what was written stays readable
  EXPECT_NE(std::system((before + " TERM=xterm " + GS_PROGRAM + " trian 2>" + name).c_str()), 0);
  char text[4096];
  const ssize_t size = ::read(terminal, text, sizeof text);
  ::close(kept_open);
  ::close(terminal);
  return std::string(text, std::size_t(std::max<ssize_t>(size, 0)));
}

TEST(Colors, ErrorsAreRedOnATerminalUnlessNoColorIsSet) {
  EXPECT_THAT(on_a_terminal("NO_COLOR="), HasSubstr("\033[31merror:\033[0m there is no"));
  const std::string plain = on_a_terminal("NO_COLOR=1");
  EXPECT_THAT(plain, AllOf(HasSubstr("error: there is no"), Not(HasSubstr("\033"))));
}

TEST_F(Flags, ErrorsInAFileHaveNoColor) {
  EXPECT_THAT(run("trian", "NO_COLOR= TERM=xterm ").err, Not(HasSubstr("\033")));
}

}  // namespace
}  // namespace gs
