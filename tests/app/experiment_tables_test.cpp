// SPDX-License-Identifier: Apache-2.0
// The tables of an experiment, from run folders that the test writes. tests/cli/experiment_test.cpp
// has experiments that really train.
#include "gs_app/experiment/tables/experiment_tables.h"

#include <gmock/gmock.h>

#include <cmath>

#include "gs_app/experiment/experiment_status.h"
#include "gs_app/experiment/tables/experiment_json.h"
#include "gs_app/experiment/tables/experiment_views.h"
#include "gs_core/error.h"
#include "gs_core/system/text/json.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
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
    const SortedJson results = {{"test", {{"psnr", psnr}}}, {"scene_hash", "hash of " + run.scene}};
    write_text(run.folder.results(), results.dump());
    write_text(run.folder.split(), R"({"train": ["1", "2", "3"], "test": ["0"]})");
    SortedJson cameras = SortedJson::array();
    for (int i = 0; i < 4; ++i) cameras.push_back({{"width", width}, {"height", 90}});
    write_text(run.folder.cameras(), cameras.dump());
  }
  void finish_all() {
    for (const ExperimentRun& run : runs_) finish(run, run.scene == "a" ? 160 : 80);
  }

  SortedJson written() {
    write_tables(experiment_, runs_, {});
    return SortedJson::parse(read_bytes(path("out/results.json")));
  }
  // The runs are a/plain/1 a/plain/2 a/flat/1 a/flat/2 b/plain/1 ...
  void finish_with(const std::vector<double>& psnrs) {
    for (std::size_t i = 0; i < psnrs.size(); ++i) finish(runs_[i], 80, psnrs[i]);
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
  run.settings.train.epochs = 100;  // the run itself knows how many steps these are
  write_text(run.folder.config(), "[train]\niterations = 4000\nepochs = 0\n");
  EXPECT_EQ(status_of(run), "a/plain/seed1 at step 2,200 of 4,500");
}

TEST_F(ExperimentTables, ShowSettingsOfOneSceneWithThatScene) {
  finish_all();
  const SortedJson tables = written();
  EXPECT_TRUE(tables.at("scenes").at(0).at("settings").empty());
  EXPECT_EQ(tables.at("scenes").at(1).at("settings").at("dataset.resolution"), 8);
  for (const SortedJson& config : tables.at("configs"))
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
  const SortedJson views = written().at("scenes").at(0).at("views");
  ASSERT_EQ(views.size(), 2u);
  EXPECT_EQ(views.at(0).at("configs"), SortedJson::array({"plain"}));
  EXPECT_EQ(views.at(0).at("size"), "80x90");
  EXPECT_EQ(views.at(1).at("configs"), SortedJson::array({"flat"}));
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
  const SortedJson summary = written().at("summary");
  EXPECT_EQ(summary.at(0).at("psnr").at("mean"), 25);
  EXPECT_NEAR(summary.at(0).at("psnr").at("standard_deviation"), std::sqrt(2), 1e-12);
  EXPECT_EQ(summary.at(1).at("finished"), 1);
  EXPECT_TRUE(summary.at(1).at("psnr").at("standard_deviation").is_null());
  EXPECT_THAT(markdown(), AllOf(HasSubstr("| a | plain | 2/2 | 25.00 ± 1.41 |"),
                                HasSubstr("3 of 8 runs are finished"), Not(HasSubstr("SSIM"))));
}

TEST_F(ExperimentTables, HaveMeansOverScenesOfSeedsThatAllScenesHave) {
  finish_with({20, 22, 25, 25, 30, 34, 35});  // b/flat/2 is missing
  const SortedJson means = written().at("scene_means");
  ASSERT_EQ(means.size(), 2u);
  EXPECT_EQ(means.at(0).at("config"), "plain");
  EXPECT_EQ(means.at(0).at("psnr").at("mean"), 26.5);  // of (20 + 30) / 2 and (22 + 34) / 2
  EXPECT_NEAR(means.at(0).at("psnr").at("standard_deviation"), 3 / std::sqrt(2), 1e-12);
  EXPECT_EQ(means.at(1).at("finished"), 1);
  EXPECT_EQ(means.at(1).at("seeds"), 2);
  EXPECT_EQ(means.at(1).at("psnr").at("mean"), 30);
  EXPECT_THAT(markdown(),
              AllOf(HasSubstr("## Means over scenes"), HasSubstr("| plain | 2/2 | 26.50 ± 2.12 |"),
                    HasSubstr("| flat | 1/2 | 30.00 |"), Not(HasSubstr("Differences"))));
  EXPECT_TRUE(written().at("baseline").is_null());
}

// Pairs differ by 3, 1, 5 and 7: their mean is 4, their standard deviation sqrt(20 / 3).
TEST_F(ExperimentTables, CompareConfigsWithTheBaselineBySceneAndSeed) {
  experiment_.baseline = "plain";
  finish_with({20, 22, 23, 23, 30, 34, 35, 41});
  SortedJson differences = written().at("differences");
  ASSERT_EQ(differences.size(), 3u);
  EXPECT_TRUE(differences.at(0).at("scene").is_null());
  EXPECT_EQ(differences.at(0).at("config"), "flat");
  EXPECT_EQ(differences.at(0).at("finished"), 4);
  EXPECT_EQ(differences.at(0).at("psnr").at("mean"), 4);
  EXPECT_NEAR(differences.at(0).at("psnr").at("standard_error"), std::sqrt(20 / 3.0) / 2, 1e-12);
  EXPECT_EQ(differences.at(1).at("scene"), "a");
  EXPECT_EQ(differences.at(1).at("psnr").at("mean"), 2);
  EXPECT_NEAR(differences.at(1).at("psnr").at("standard_error"), 1, 1e-12);
  EXPECT_THAT(markdown(), AllOf(HasSubstr("## Differences to plain"),
                                HasSubstr("| flat | all | 4/4 | +4.00 ± 1.29 |"),
                                HasSubstr("| flat | a | 2/2 | +2.00 ± 1.00 |")));
  // Signs are those of what is shown.
  finish_with({20, 22, 20, 22, 30, 34, 29.999, 30});
  written();
  EXPECT_THAT(markdown(), AllOf(HasSubstr("| flat | a | 2/2 | 0.00 ± 0.00 |"),
                                HasSubstr("| flat | b | 2/2 | -2.00 ± 2.00 |")));
  finish_with({20, 22, 23, 23, 30, 34, 35, 41});
  fs::remove(runs_[0].folder.results());  // a/plain/1: the pair of a/flat/1
  fs::remove(runs_[7].folder.results());
  differences = written().at("differences");
  EXPECT_EQ(differences.at(0).at("finished"), 2);
  EXPECT_EQ(differences.at(0).at("pairs"), 4);
  EXPECT_EQ(differences.at(0).at("psnr").at("mean"), 3);
  EXPECT_TRUE(differences.at(1).at("psnr").at("standard_error").is_null());
  EXPECT_THAT(markdown(), HasSubstr("| flat | a | 1/2 | +1.00 |"));
}

TEST_F(ExperimentTables, ABaselineIsTheNameOfAConfig) {
  const std::string text = read_bytes(path("e.toml"));
  write_bytes(path("e.toml"), "baseline = 'plain'\n" + text);
  EXPECT_EQ(read_experiment(path("e.toml")).baseline, "plain");
  write_bytes(path("e.toml"), "baseline = 'plane'\n" + text);
  try {
    read_experiment(path("e.toml"));
    FAIL() << "a baseline without a config";
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("e.toml:1: baseline names no config"),
                                    HasSubstr("did you mean plain?")));
  }
}

TEST_F(ExperimentTables, SayWhatTheyWereMadeWith) {
  finish_all();
  const SortedJson provenance = written().at("provenance");
  EXPECT_THAT(provenance.at("command").at(0), HasSubstr("app_tests"));
  EXPECT_EQ(provenance.at("folder"), fs::current_path().string());
  EXPECT_THAT(provenance.at("compiler"), ::testing::AnyOf(HasSubstr("GCC"), HasSubstr("clang")));
  EXPECT_TRUE(provenance.contains("cuda"));
  EXPECT_THAT(markdown(), AllOf(HasSubstr("- command: `"), HasSubstr("app_tests")));
}

// git's output, shortened. The hash is that of Python's FNV-1a of these bytes.
TEST_F(ExperimentTables, NameUncommittedChangesByFileAndHash) {
  const UncommittedChanges changes = changes_of(
      "diff --git a/cuda/blend.cu b/cuda/blend.cu\n--- a/cuda/blend.cu\n+++ b/cuda/blend.cu\n"
      "@@ -1 +1 @@\n-one\n+diff --git a/no b/no\ndiff --git a/new b/new\nnew file mode 100644\n");
  EXPECT_EQ(changes.files, (std::vector<std::string>{"cuda/blend.cu", "new"}));
  EXPECT_EQ(changes.hash, "f1c393555f274a6a");
  Json tables = experiment_json(experiment_, runs_, {});
  tables["provenance"] = provenance_json(changes);
  const Json& json = tables.at("provenance").at("uncommitted");
  EXPECT_EQ(json.at("diff"), "uncommitted-f1c393555f274a6a.diff");
  EXPECT_EQ(json.at("files").size(), 2u);
  EXPECT_THAT(experiment_markdown(tables),
              HasSubstr("f1c393555f274a6a.diff: `cuda/blend.cu`, `new`"));
}

}  // namespace
}  // namespace gs
