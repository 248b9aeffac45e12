// SPDX-License-Identifier: Apache-2.0
// gemsplat config: its output for files, presets, runs and flags together.
#include <gmock/gmock.h>

#include "tests/support/program.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

using ConfigVerb = Program;

TEST_F(ConfigVerb, PrintsAConfigThatReadsBack) {
  const Outcome first = run("config -c fast --set train.seed=7");
  ASSERT_EQ(first.code, 0) << first.err;
  EXPECT_THAT(first.out, AllOf(HasSubstr("epochs = 50"), HasSubstr("seed = 7")));
  write_bytes(path("printed.toml"), first.out);
  EXPECT_EQ(run("config -c " + text("printed.toml")).out, first.out);
}

TEST_F(ConfigVerb, ListsThePresetsAndTrainTakesThem) {
  const Outcome list = run("config --list");
  EXPECT_THAT(list.out,
              AllOf(HasSubstr("fast "), HasSubstr("adaptive "), HasSubstr("paper_3dgs ")));
  EXPECT_THAT(run("train --config fast --print-config").out, HasSubstr("epochs = 50"));
  const Outcome unknown = run("train --config fsat --print-config");
  EXPECT_EQ(unknown.code, 3);
  EXPECT_THAT(unknown.err, HasSubstr("did you mean the preset fast?"));
}

TEST_F(ConfigVerb, ExplainNamesTheOriginOfEachValue) {
  write_bytes(path("a.toml"), "base = 'fast'\n[density]\nevery = 50\n");
  const Outcome outcome =
      run("config explain density.every train.epochs train.seed train.device loss -c " +
          text("a.toml") + " --set train.seed=3 --device cpu");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out,
              AllOf(HasSubstr("density.every = 50\n  from     " + text("a.toml") + ":3"),
                    HasSubstr("train.epochs = 50\n  from     preset fast:"),
                    HasSubstr("train.seed = 3\n  from     --set"),
                    HasSubstr("train.device = \"cpu\"\n  from     flag"),
                    HasSubstr("loss.lambda_dssim = 0.2\n  from     default")));
  const Outcome unknown = run("config explain density.evry");
  EXPECT_EQ(unknown.code, 2);
  EXPECT_THAT(unknown.err, HasSubstr("did you mean density.every?"));
}

TEST_F(ConfigVerb, DiffComparesRunsFilesAndPresets) {
  ASSERT_EQ(train("out", "-q").code, 0);
  const Outcome runs = run("config diff " + text("out") + " fast");
  ASSERT_EQ(runs.code, 0) << runs.err;
  EXPECT_THAT(runs.out,
              AllOf(HasSubstr("train.iterations = 20 -> 0"), HasSubstr("train.epochs = 100 -> 50"),
                    HasSubstr(text("out/config.toml") + ":"), Not(HasSubstr("render."))));
  EXPECT_THAT(run("config diff fast").out, HasSubstr("train.epochs = 100 -> 50"));
  EXPECT_EQ(run("config diff fast fast").out, "no setting differs\n");
  const Outcome nothing = run("config diff");
  EXPECT_EQ(nothing.code, 2);
  EXPECT_THAT(nothing.err, AllOf(HasSubstr("A is missing: a TOML file"),
                                 HasSubstr("`gemsplat config diff --help`")));
  EXPECT_THAT(run("config diff fast --sett a.b=1").err, HasSubstr("did you mean --set?"));
}

TEST_F(ConfigVerb, ACircleAndAValueOutOfRangeNameTheirFiles) {
  write_bytes(path("a.toml"), "base = 'b.toml'\n");
  write_bytes(path("b.toml"), "base = 'a.toml'\n");
  const Outcome circle = run("config -c " + text("a.toml"));
  EXPECT_EQ(circle.code, 2);
  EXPECT_THAT(circle.err, HasSubstr("a.toml -> " + text("b.toml")));
  write_bytes(path("b.toml"), "[render]\nnear_plane = 20000\n");
  EXPECT_THAT(run("config -c " + text("a.toml")).err,
              HasSubstr(text("b.toml") + ":2: render.near_plane"));
}

}  // namespace
}  // namespace gs
