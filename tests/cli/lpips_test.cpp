// SPDX-License-Identifier: Apache-2.0
// LPIPS in train, eval, reports and experiments, with a small network.
#include <gmock/gmock.h>

#include "gs_core/system/text/json.h"
#include "gs_eval/lpips/feature_network.h"
#include "tests/support/lpips_file.h"
#include "tests/support/program.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class LpipsProgram : public Program {
 protected:
  void SetUp() override {
    Program::SetUp();
    write_network(path("net.safetensors"), patterned_network("alex", {4, 6, 5, 3, 4}));
    if (!can_measure_lpips()) GTEST_SKIP() << "built without OpenCV's module dnn";
  }
  const std::string lpips_ = " --lpips " + text("net.safetensors");
};

TEST_F(LpipsProgram, IsWhereFlipIsAndOnlyWhereItIsAskedFor) {
  ASSERT_EQ(train("plain").code, 0);
  EXPECT_FALSE(json("plain/results.json").at("test").contains("lpips"));
  EXPECT_FALSE(json("plain/results.json").contains("lpips_network"));
  ASSERT_EQ(train("out", lpips_).code, 0);
  EXPECT_EQ(read_bytes(path("out/point_cloud/iteration_20/point_cloud.ply")),
            read_bytes(path("plain/point_cloud/iteration_20/point_cloud.ply")));

  const SortedJson results = json("out/results.json"), &test = results.at("test");
  EXPECT_GT(test.at("lpips"), 0);
  EXPECT_FALSE(results.at("train").contains("lpips"));
  const SortedJson& network = results.at("lpips_network");
  EXPECT_EQ(network.at("name"), "alex");
  EXPECT_EQ(network.at("file"), text("net.safetensors"));
  EXPECT_EQ(network.at("hash").get<std::string>().size(), 16u);
  for (const auto& [name, view] : json("out/per_view.json").at("test").items())
    EXPECT_GT(view.at("lpips"), 0) << name;

  const Outcome report = run("report --json " + text("out"));
  const SortedJson data = SortedJson::parse(report.out);
  EXPECT_EQ(data.at("results").at("test").at("lpips"), test.at("lpips"));
  EXPECT_GT(data.at("views").at("list").at(0).at("lpips"), 0);
}

TEST_F(LpipsProgram, EvalMeasuresARunWithoutTrainingItAgain) {
  ASSERT_EQ(train("out", lpips_).code, 0);
  ASSERT_EQ(train("plain").code, 0);
  const Outcome outcome = run("eval " + text("plain") + " --json --device cpu" + lpips_);
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const SortedJson figures = SortedJson::parse(outcome.out), results = json("out/results.json");
  EXPECT_NEAR(figures.at("lpips").get<double>(), results.at("test").at("lpips").get<double>(),
              1e-3);
  EXPECT_EQ(figures.at("lpips_network"), results.at("lpips_network"));
  for (const auto& [name, view] : figures.at("views").items())
    EXPECT_GT(view.at("lpips"), 0) << name;
  const Outcome lines = run("eval " + text("out") + " --device cpu");  // with the file of the run
  EXPECT_THAT(lines.out, HasSubstr(" LPIPS over 2 views"));
  EXPECT_THAT(lines.err, HasSubstr("  LPIPS "));
  EXPECT_THAT(run("eval " + text("out") + " --device cpu --lpips none").out,
              AllOf(HasSubstr(" FLIP over"), Not(HasSubstr("LPIPS"))));
}

TEST_F(LpipsProgram, AFileThatCannotBeUsedIsRefusedBeforeTheFirstStep) {
  const Outcome missing = train("out", " --lpips " + text("none.safetensors"));
  EXPECT_EQ(missing.code, 2);
  EXPECT_THAT(missing.err, AllOf(HasSubstr(text("none.safetensors")), HasSubstr("--lpips none")));
  write_bytes(path("text.safetensors"), "some text that is no network");
  const Outcome damaged = train("out", " --lpips " + text("text.safetensors"));
  EXPECT_EQ(damaged.code, 3);
  EXPECT_THAT(damaged.err, HasSubstr(text("text.safetensors") + ": it is no safetensors file"));
  const Outcome small = train("out", lpips_ + " -r 2");  // 20x16 pixels
  EXPECT_EQ(small.code, 2);
  EXPECT_THAT(small.err, HasSubstr("20x16 pixels are too small for LPIPS"));
  EXPECT_FALSE(std::filesystem::exists(path("out/config.toml")));
}

TEST_F(LpipsProgram, ARunThatLostItsFileSaysHowToEvaluateIt) {
  ASSERT_EQ(train("out", lpips_).code, 0);
  std::filesystem::remove(path("net.safetensors"));
  const Outcome outcome = run("eval " + text("out") + " --device cpu");
  EXPECT_EQ(outcome.code, 2);
  EXPECT_THAT(outcome.err, AllOf(HasSubstr(text("net.safetensors")), HasSubstr("--lpips none")));
  EXPECT_EQ(run("eval " + text("out") + " --device cpu --lpips none").code, 0);
}

TEST_F(LpipsProgram, TablesOfAnExperimentHaveAColumn) {
  write_scene(path("scene"));
  write_bytes(path("e.toml"),
              "output = 'tables'\nscenes = ['scene']\nseeds = [1]\n"
              "configs = [{name = 'plain'}]\n[set]\n"
              "train = {iterations = 5, device = 'cpu'}\n"
              "dataset = {eval = true, test_every = 3}\n"
              "eval = {lpips = 'net.safetensors'}\n");  // beside this file
  const Outcome outcome = run("experiment " + text("e.toml"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const SortedJson results = json("tables/results.json");
  EXPECT_EQ(results.at("runs").at(0).at("results").at("lpips_network").at("name"), "alex");
  EXPECT_GT(results.at("summary").at(0).at("lpips").at("mean"), 0);
  EXPECT_THAT(read_bytes(path("tables/results.md")), HasSubstr("| LPIPS |"));
}

}  // namespace
}  // namespace gs
