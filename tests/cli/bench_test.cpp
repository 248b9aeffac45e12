// SPDX-License-Identifier: Apache-2.0
// `gemsplat bench` and `gemsplat selftest` on the CPU.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "gs_core/system/text/json.h"
#include "tests/support/program.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST_F(Program, BenchTimesAGeneratedScene) {
  const Outcome outcome =
      run("bench --gaussians 500 --width 64 --height 48 --views 3 --steps 3 --warmup 1 --frames 2 "
          "--scales 1,2 --device cpu --progress json -o " +
          text("bench.json"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("training: "), HasSubstr("rendering: "),
                                 HasSubstr("blend backward")));
  EXPECT_THAT(outcome.err,
              AllOf(HasSubstr(R"("part":"training","unit":"step","done":7,"total":7)"),
                    HasSubstr(R"("part":"rendering","unit":"frame","done":15,"total":15)")));
  const SortedJson figures = json("bench.json");
  EXPECT_EQ(figures.at("device"), "cpu");
  EXPECT_TRUE(figures.contains("version"));
  EXPECT_EQ(figures.at("model"), "generated");
  EXPECT_EQ(figures.at("scene"), "generated");
  EXPECT_EQ(figures.at("width"), 64);
  EXPECT_EQ(figures.at("height"), 48);
  EXPECT_EQ(figures.at("sh_degree"), 3);
  EXPECT_EQ(figures.at("num_gaussians"), 500);
  EXPECT_GT(figures.at("visible"), 100.0);
  EXPECT_GE(figures.at("instances"), figures.at("visible"));
  EXPECT_EQ(figures.at("train_views"), 3);
  EXPECT_EQ(figures.at("test_views"), 0);
  EXPECT_EQ(figures.at("train").at("steps"), 3);
  EXPECT_EQ(figures.at("train").at("warmup"), 1);
  EXPECT_GT(figures.at("train").at("ms_per_step"), 0.0);
  EXPECT_EQ(figures.at("train").at("stages").size(), 9u);
  ASSERT_EQ(figures.at("render").size(), 2u);
  EXPECT_EQ(figures.at("render")[1].at("width"), 128);
  EXPECT_GT(figures.at("render")[1].at("ms_per_frame"), 0.0);
  EXPECT_GT(figures.at("copy_gb_per_s"), 0.0);
  EXPECT_FALSE(figures.contains("peak_gpu_bytes"));
}

TEST_F(Program, BenchOfARunTakesItsViews) {
  ASSERT_EQ(train("out").code, 0);
  const Outcome outcome =
      run("bench " + text("out") + " --steps 2 --warmup 0 --frames 1 --device cpu --json -q");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const SortedJson figures = SortedJson::parse(outcome.out);
  EXPECT_EQ(figures.at("num_gaussians"), json("out/results.json").at("num_gaussians"));
  EXPECT_EQ(figures.at("train_views"), 4);
  EXPECT_EQ(figures.at("test_views"), 2);
  EXPECT_EQ(figures.at("width"), kWidth);
}

TEST_F(Program, BenchStandsBesideOtherReports) {
  const std::string small =
      "bench --gaussians 50 --width 32 --height 32 --views 2 --steps 2 --warmup 0 --frames 1 "
      "--device cpu -q ";
  ASSERT_EQ(run(small + "-o " + text("before.json")).code, 0);
  const auto write = [&](const char* file, const char* content) {
    std::ofstream(path(file)) << content;
  };
  write("peer.json", R"({"program": "Peer 1.0", "num_gaussians": 60, "width": 32,
      "height": 32, "device": "cpu", "render": [{"width": 32, "height": 32, "ms_per_frame": 1e6}],
      "protocol": {"frame": "kernels alone"}})");
  const Outcome outcome = run(small + "--against " + text("before.json") + "," + text("peer.json"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out,
              AllOf(HasSubstr("| this call | before | Peer 1.0 |"),
                    HasSubstr("| Gaussians | 50 | 50 | 60 |"),
                    HasSubstr("training step, 32x32 / ms"), HasSubstr("frame, 32x32 / ms"),
                    HasSubstr("1000000.000 (x "), HasSubstr("- Peer 1.0, a frame: kernels alone\n"),
                    HasSubstr("- Peer 1.0, a step: the file does not say\n"),
                    HasSubstr("- before, a step: wall time"),
                    HasSubstr("- Peer 1.0 has another number of Gaussians than this call.\n")));
  EXPECT_THAT(outcome.out, Not(HasSubstr("before has another")));
  for (const auto& [file, message] :
       {std::pair("none.json", "none.json"), std::pair("text.json", "text.json"),
        std::pair("empty.json", "has no times")}) {
    write("text.json", "frames");
    write("empty.json", "{}");
    const Outcome refused = run(small + "--against " + text(file));
    EXPECT_NE(refused.code, 0) << file;
    EXPECT_THAT(refused.err, HasSubstr(message)) << file;
  }
}

TEST_F(Program, BenchRefusesWhatItCannotTime) {
  const auto expect_refusal = [&](const std::string& arguments, const std::string& message) {
    const Outcome outcome = run("bench " + arguments);
    EXPECT_EQ(outcome.code, 2) << arguments;
    EXPECT_THAT(outcome.err, HasSubstr(message)) << arguments;
  };
  expect_refusal("", "--gaussians");
  expect_refusal("--gaussians 0", "--gaussians");
  expect_refusal("--gaussians 5 " + text("out"), "one of these");
  expect_refusal("--gaussians 5 --data " + text("scene"), "--width");
  expect_refusal("--gaussians 5 --steps 0", "--steps");
  expect_refusal("--gaussians 5 --width 5000 --scales 90", "--scales");
}

TEST_F(Program, SelftestOnTheCpuAgrees) {
  const Outcome outcome = run("selftest --device cpu");
  EXPECT_EQ(outcome.code, 0) << outcome.out << outcome.err;
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("mean"), HasSubstr("log_scale"), HasSubstr("rotation"),
                                 HasSubstr("logit_opacity"), HasSubstr("sh0"), HasSubstr("sh_rest"),
                                 HasSubstr("all 9 agree")));
  EXPECT_THAT(outcome.out, HasSubstr("left out, --device cpu was given"));
  const SortedJson report = SortedJson::parse(run("selftest --device cpu --json").out);
  EXPECT_EQ(report.at("agrees"), true);
  EXPECT_EQ(report.at("gradients").size(), 9u);
  EXPECT_EQ(run("selftest --device gpu").code, 2);
}

}  // namespace
}  // namespace gs
