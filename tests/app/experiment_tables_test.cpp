// SPDX-License-Identifier: Apache-2.0
// The tables of an experiment, from run folders that the test writes. tests/cli/experiment_test.cpp
// has experiments that really train.
#include "gs_app/experiment/tables/experiment_tables.h"

#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "gs_app/experiment/experiment_status.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

/// Scenes a and b, of which b has settings of its own, and the configs "plain" and "flat".
class ExperimentTables : public ::testing::Test {
 protected:
  ExperimentTables() {
    for (const char* scene : {"a", "b"}) fs::create_directories(path(scene));
    write_bytes(path("e.toml"),
                "output = 'out'\nseeds = [1, 2]\n"
                "scenes = ['a', {path = 'b', set = {\"dataset.resolution\" = 8}}]\n"
                "[set]\ndataset = {eval = true, resolution = 4}\n"
                "[[configs]]\nname = 'plain'\n"
                "[[configs]]\nname = 'flat'\nset = {\"model.sh_degree\" = 0}\n");
    experiment_ = read_experiment(path("e.toml"));
    runs_ = runs_of(experiment_);
  }

  fs::path path(const std::string& name) const { return temp_.path() / name; }

  /// Writes the files of a finished run that the tables read: settings, results, and views of this
  /// width.
  void finish(const ExperimentRun& run, int width, double psnr = 25) {
    prepare(run);
    const Json results = {{"test", {{"psnr", psnr}}}, {"scene_hash", "hash of " + run.scene}};
    write_text(run.folder.results(), results.dump());
    write_text(run.folder.split(), R"({"train": ["1", "2", "3"], "test": ["0"]})");
    Json cameras = Json::array();
    for (int i = 0; i < 4; ++i) cameras.push_back({{"width", width}, {"height", 90}});
    write_text(run.folder.cameras(), cameras.dump());
  }
  void finish_all() {
    for (const ExperimentRun& run : runs_) finish(run, run.scene == "a" ? 160 : 80);
  }

  Json written() {
    write_tables(experiment_, runs_, {});
    return Json::parse(read_bytes(path("out/results.json")));
  }
  std::string markdown() const { return read_bytes(path("out/results.md")); }

  TempFolder temp_;
  Experiment experiment_;
  std::vector<ExperimentRun> runs_;
};

TEST_F(ExperimentTables, AModelToStartFromIsRelativeToTheFile) {
  experiment_.settings.push_back({"model.start_from=models/./first.ply", ""});
  EXPECT_EQ(runs_of(experiment_).front().settings.model.start_from, path("models/first.ply"));
  experiment_.settings.back().assignment = "model.start_from=/models/first.ply";
  EXPECT_EQ(runs_of(experiment_).front().settings.model.start_from, "/models/first.ply");
}

using ExperimentStatus = ExperimentTables;

TEST_F(ExperimentStatus, IsTheLastWholeRowOfTheMetrics) {
  ExperimentRun& run = runs_.front();
  run.settings.train.iterations = 7000;
  run.settings.train.extra_steps = 500;
  EXPECT_EQ(status_of(run), "a/plain/seed1 at step 0 of 7,500");
  prepare(run);
  write_text(run.folder.metrics(), "step,loss\n100,0.5\n2200,0.4\n23");  // it is being written
  EXPECT_EQ(status_of(run), "a/plain/seed1 at step 2,200 of 7,500");
}

TEST_F(ExperimentTables, ShowSettingsOfOneSceneWithThatScene) {
  finish_all();
  const Json tables = written();
  EXPECT_TRUE(tables.at("scenes").at(0).at("settings").empty());
  EXPECT_EQ(tables.at("scenes").at(1).at("settings").at("dataset.resolution"), 8);
  for (const Json& config : tables.at("configs"))
    EXPECT_EQ(config.at("settings").at("dataset.resolution"), 4) << config;
  EXPECT_FALSE(tables.at("configs").at(0).at("settings").contains("model.sh_degree"));
  EXPECT_EQ(tables.at("configs").at(1).at("settings").at("model.sh_degree"), 0);
  EXPECT_THAT(markdown(),
              AllOf(HasSubstr("| b | `dataset.resolution` = 8 | all | 3 | 1 | 80x90 | hash of b |"),
                    HasSubstr("| a |  | all | 3 | 1 | 160x90 | hash of a |"),
                    HasSubstr("| plain | `dataset.resolution` = 4, `dataset.eval` = true |")));
}

TEST_F(ExperimentTables, ShowTheViewsOfAScenePerConfigWhereTheyDiffer) {
  for (const ExperimentRun& run : runs_) finish(run, run.config == "flat" ? 40 : 80);
  const Json views = written().at("scenes").at(0).at("views");
  ASSERT_EQ(views.size(), 2u);
  EXPECT_EQ(views.at(0).at("configs"), Json::array({"plain"}));
  EXPECT_EQ(views.at(0).at("size"), "80x90");
  EXPECT_EQ(views.at(1).at("configs"), Json::array({"flat"}));
  EXPECT_EQ(views.at(1).at("size"), "40x90");
  EXPECT_THAT(markdown(), HasSubstr("| a |  | flat | 3 | 1 | 40x90 |"));
}

TEST_F(ExperimentTables, LeaveOutViewsThatAreNotKnown) {
  EXPECT_TRUE(written().at("scenes").at(1).at("views").empty());
  EXPECT_THAT(markdown(), HasSubstr("| b | `dataset.resolution` = 8 | - |"));
  finish_all();
  for (const ExperimentRun& run : runs_) write_text(run.folder.cameras(), "[{\"wid");
  EXPECT_TRUE(written().at("scenes").at(1).at("views").empty());
}

TEST_F(ExperimentTables, HaveMeansAndDeviationsOverFinishedSeeds) {
  finish(runs_[0], 80, 24);
  finish(runs_[1], 80, 26);
  finish(runs_[2], 80, 30);
  const Json summary = written().at("summary");
  EXPECT_EQ(summary.at(0).at("psnr").at("mean"), 25);
  EXPECT_NEAR(summary.at(0).at("psnr").at("standard_deviation"), std::sqrt(2), 1e-12);
  EXPECT_EQ(summary.at(1).at("finished"), 1);
  EXPECT_TRUE(summary.at(1).at("psnr").at("standard_deviation").is_null());
  EXPECT_THAT(markdown(), AllOf(HasSubstr("| a | plain | 2/2 | 25.00 ± 1.41 |"),
                                HasSubstr("3 of 8 runs are finished"), Not(HasSubstr("SSIM"))));
}

}  // namespace
}  // namespace gs
