// SPDX-License-Identifier: Apache-2.0
// The data of reports, gathered from complete, unfinished and damaged folders of runs and
// experiments. apps/web/tests/report_test.mjs tests how a report looks.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <numeric>

#include "gs_core/system/text/json.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class Report : public Program {
 protected:
  SortedJson data_of(const std::string& folder) {
    const Outcome outcome = run("report --json " + text(folder));
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return SortedJson::parse(outcome.out, nullptr, false);
  }
  std::string refusal(const std::string& folder) {
    const Outcome outcome = run("report --json " + text(folder));
    EXPECT_EQ(outcome.code, 3) << outcome.out;
    return outcome.err;
  }
  bool can_write() {
    return SortedJson::parse(run("info --json").out).at("reports").at("available") == true;
  }
};

std::vector<int> numbers(const SortedJson& list) { return list.get<std::vector<int>>(); }

TEST_F(Report, OfARunHasItsResultsCurvesViewsAndHistograms) {
  ASSERT_EQ(train("out", "--test-steps 7 --set density.max_gaussians=100").code, 0);
  const SortedJson data = data_of("out");
  EXPECT_EQ(data.at("kind"), "run");
  EXPECT_EQ(data.at("title"), "scene");
  EXPECT_EQ(data.at("state"), "finished");
  EXPECT_EQ(data.at("results"), json("out/results.json"));
  EXPECT_TRUE(data.at("notes").empty()) << data.at("notes");

  EXPECT_EQ(numbers(data.at("metrics").at("step")), (std::vector<int>{5, 7, 10, 15, 20}));
  EXPECT_TRUE(data.at("metrics").at("test_psnr").at(0).is_null());
  EXPECT_GT(data.at("metrics").at("test_psnr").at(1), 1.0);
  // The step after a row; its times are written with the next one.
  EXPECT_EQ(numbers(data.at("stages").at("step")), (std::vector<int>{6, 11, 16}));
  EXPECT_EQ(data.at("stages").at("names").at(0), "preprocess");
  EXPECT_GT(data.at("stages").at("milliseconds").at(0).at(1), 0.0);
  EXPECT_EQ(numbers(data.at("memory").at("step")), (std::vector<int>{5, 10, 15, 20}));
  EXPECT_GT(data.at("memory").at("host").at(0), 1e6);

  const SortedJson& histograms = data.at("histograms");
  const std::size_t count = data.at("results").at("num_gaussians");
  EXPECT_EQ(histograms.at("count"), count);
  for (const SortedJson& histogram :
       {histograms.at("opacity"), histograms.at("scales").at(0), histograms.at("scales").at(1)}) {
    const auto counts = histogram.at("counts").get<std::vector<std::size_t>>();
    EXPECT_EQ(std::accumulate(counts.begin(), counts.end(), std::size_t(0)), count);
  }
  EXPECT_LE(histograms.at("scales").at(1).at("median"), histograms.at("scales").at(0).at("median"));

  const SortedJson& views = data.at("views");
  EXPECT_EQ(views.at("split"), "test");
  ASSERT_EQ(views.at("list").size(), 2u);
  const SortedJson& view = views.at("list").at(1);
  EXPECT_EQ(view.at("name"), "view_3.png");
  EXPECT_EQ(view.at("psnr"), json("out/per_view.json").at("test").at("view_3.png").at("psnr"));
  EXPECT_EQ(view.at("width"), kWidth);
  for (const char* key : {"photo", "render", "error", "flip_picture"})
    EXPECT_TRUE(view.at(key).get<std::string>().starts_with("data:image/jpeg;base64,/9j/")) << key;

  const std::string changed = data.at("changed").dump();
  EXPECT_THAT(changed, AllOf(HasSubstr("density.max_gaussians"), HasSubstr("train.iterations"),
                             Not(HasSubstr("dataset.source"))));
  EXPECT_EQ(data.at("config"), read_bytes(path("out/config.toml")));
}

TEST_F(Report, TimesOfAnEvaluationAreNotTakenForThoseOfAStep) {
  ASSERT_EQ(train("out", "--test-steps 6").code, 0);
  EXPECT_EQ(numbers(data_of("out").at("stages").at("step")), (std::vector<int>{11, 16}));
}

TEST_F(Report, IsWrittenAtTheEndOfARunAndAnew) {
  if (!can_write()) GTEST_SKIP() << "this build has no npm";
  const Outcome trained = train("out");
  ASSERT_EQ(trained.code, 0) << trained.err;
  EXPECT_THAT(trained.out, AllOf(HasSubstr("report:     " + text("out/report.html")),
                                 HasSubstr("look at it: gemsplat view " + text("out") + "\n")));
  const std::string page = read_bytes(path("out/report.html"));
  EXPECT_THAT(page, AllOf(HasSubstr("<!doctype html>"), HasSubstr("\"kind\":\"run\""),
                          HasSubstr("Copyright (c)"), Not(HasSubstr("@GEMSPLAT_DATA@"))));
  const Outcome again = run("report " + text("out") + " -o " + text("else/page.html"));
  EXPECT_EQ(again.code, 0) << again.err;
  EXPECT_TRUE(fs::exists(path("else/page.html")));
}

TEST_F(Report, NamesInItsDataCannotEndTheElementTheyStandIn) {
  if (!can_write()) GTEST_SKIP() << "this build has no npm";
  ASSERT_EQ(train("out").code, 0);
  std::string results = read_bytes(path("out/results.json"));
  const std::string evil = "</script><script>alert(1)</script><!--";
  results.replace(results.find("\"cpu\","), 5, SortedJson(evil).dump());
  write_bytes(path("out/results.json"), results);
  ASSERT_EQ(run("report " + text("out")).code, 0);
  const std::string page = read_bytes(path("out/report.html"));
  EXPECT_THAT(page, Not(HasSubstr("alert(1)</script>")));
  const std::size_t begin = page.find('>', page.find("id=\"data\"")) + 1;
  const std::string data = page.substr(begin, page.find("</script>", begin) - begin);
  EXPECT_EQ(SortedJson::parse(data).at("results").at("device"), evil);
}

TEST_F(Report, OfARunWithAMeshShowsItBesidePhotos) {
  ASSERT_EQ(train("out").code, 0);
  EXPECT_TRUE(data_of("out").at("mesh").is_null());
  ASSERT_EQ(run("mesh " + text("out") + " --collision --voxel 0.2 -o " + text("out/mesh.glb")).code,
            0);
  const SortedJson mesh = data_of("out").at("mesh");
  EXPECT_EQ(mesh.at("name"), "mesh.glb");
  EXPECT_GT(mesh.at("triangles"), 10);
  EXPECT_EQ(mesh.at("views"), 2);
  EXPECT_GT(mesh.at("psnr"), 3.0);
  EXPECT_EQ(mesh.at("pictures").size(), 2u);
  for (const char* kind : {"photo", "mesh"})
    EXPECT_EQ(mesh.at("pictures").at(1).at(kind).get<std::string>().find("data:image/jpeg"), 0u);
  const Outcome measured =
      run("mesh-error " + text("out/mesh.glb") + " --json --data " + text("out"));
  EXPECT_NEAR(mesh.at("psnr"), Json::parse(measured.out)["pictures"]["psnr"], 1e-9);
  write_bytes(path("out/mesh.glb"), "damaged");
  const SortedJson damaged = data_of("out");
  EXPECT_TRUE(damaged.at("mesh").is_null());
  EXPECT_THAT(damaged.at("notes").at(0), ::testing::HasSubstr("mesh.glb"));
}

TEST_F(Report, OfARunWithoutTestViewsShowsTrainingViews) {
  write_scene(path("scene"));
  ASSERT_EQ(run("train " + text("scene") + " -o " + text("out") + " -i 3 --device cpu").code, 0);
  const SortedJson data = data_of("out");
  EXPECT_EQ(data.at("views").at("split"), "train");
  EXPECT_EQ(data.at("views").at("list").size(), std::size_t(kViews));
  EXPECT_TRUE(data.at("views").at("list").at(5).contains("photo"));
  EXPECT_EQ(numbers(data.at("metrics").at("step")), (std::vector<int>{3}));
}

TEST_F(Report, OfAnUnfinishedRunSaysWhatIsMissing) {
  ASSERT_EQ(train("out").code, 0);
  for (const char* name : {"results.json", "per_view.json", "profile.csv"})
    fs::remove(path("out") / name);
  fs::remove_all(path("out/point_cloud"));
  // The last row is cut short, as by a kill.
  write_bytes(path("out/metrics.csv"), read_bytes(path("out/metrics.csv")) + "25,0.1");
  const SortedJson data = data_of("out");
  EXPECT_EQ(data.at("state"), "unfinished");
  EXPECT_TRUE(data.at("results").is_null());
  EXPECT_EQ(numbers(data.at("metrics").at("step")), (std::vector<int>{5, 10, 15, 20}));
  EXPECT_FALSE(data.contains("stages") || data.contains("histograms") || data.contains("views"));
  EXPECT_THAT(data.at("notes").dump(), HasSubstr("No model is saved yet"));
}

TEST_F(Report, MissingPicturesAreSaidAndDamagedFilesNamed) {
  ASSERT_EQ(train("out").code, 0);
  const fs::path render = path("out/test/ours_20/renders/00000.png");
  const std::string picture = read_bytes(render);
  fs::remove(render);
  const SortedJson data = data_of("out");
  EXPECT_FALSE(data.at("views").at("list").at(0).contains("photo"));
  EXPECT_TRUE(data.at("views").at("list").at(1).contains("photo"));
  EXPECT_THAT(data.at("notes").dump(), HasSubstr("1 views have no pictures"));
  write_bytes(render, picture.substr(0, picture.size() / 2));
  EXPECT_THAT(refusal("out"), HasSubstr(render.string()));
  write_bytes(render, picture);

  for (const std::string name : {"results.json", "per_view.json", "metrics.csv", "profile.csv",
                                 "point_cloud/iteration_20/point_cloud.ply", "split.json"}) {
    const std::string whole = read_bytes(path("out") / name);
    std::string damaged = whole;
    damaged.replace(whole.size() / 2, 8, "\n,#,#,\"\n");
    write_bytes(path("out") / name,
                name.ends_with("ply") ? whole.substr(0, whole.size() / 2) : damaged);
    EXPECT_THAT(refusal("out"), HasSubstr(text("out/" + name)));
    write_bytes(path("out") / name, whole);
  }
  EXPECT_TRUE(data_of("out").at("notes").empty());
}

TEST_F(Report, AFifoInARunIsRefusedInsteadOfWaitedFor) {
  ASSERT_EQ(train("out").code, 0);
  fs::remove(path("out/metrics.csv"));
  ASSERT_EQ(::mkfifo(path("out/metrics.csv").c_str(), 0600), 0);
  const Outcome report = run("report " + text("out"), "timeout 60 ");
  EXPECT_EQ(report.code, 3);
  EXPECT_THAT(report.err, AllOf(HasSubstr("metrics.csv"), HasSubstr("regular file")));
}

TEST_F(Report, HasEveryColumnOfMetricsCsv) {
  ASSERT_EQ(train("out").code, 0);
  write_bytes(path("out/metrics.csv"), "step,loss,sharpness\n5,0.25,7\n10,0.125,\n");
  EXPECT_EQ(data_of("out").at("metrics"),
            SortedJson({{"step", {5, 10}}, {"loss", {0.25, 0.125}}, {"sharpness", {7, nullptr}}}));
}

TEST_F(Report, AColumnOfMetricsCsvThatIsNamedTwiceIsRefused) {
  ASSERT_EQ(train("out").code, 0);
  write_bytes(path("out/metrics.csv"), "step,loss,loss\n5,0.25,7\n");
  EXPECT_THAT(refusal("out"), AllOf(HasSubstr("metrics.csv"), HasSubstr("its first line")));
}

TEST_F(Report, ASceneInTheFolderOfItsRunHasTheNameOfTheRun) {
  write_scene(path("garden/scene"));
  ASSERT_EQ(run("train " + text("garden/scene") + " -o " + text("garden") + kTrain).code, 0);
  EXPECT_EQ(data_of("garden").at("title"), "garden");
  EXPECT_EQ(data_of("garden/").at("title"), "garden");
}

TEST_F(Report, AConfigOfAnotherVersionIsShownAllTheSame) {
  ASSERT_EQ(train("out").code, 0);
  write_bytes(path("out/config.toml"), "[train]\nfuture = 1\n");
  const SortedJson data = data_of("out");
  EXPECT_EQ(data.at("title"), "out");
  EXPECT_THAT(data.at("notes").dump(), HasSubstr("future"));
  EXPECT_EQ(data.at("config"), "[train]\nfuture = 1\n");
}

TEST_F(Report, OfAResumedRunHasTheWholeCurve) {
  ASSERT_EQ(train("out", "--checkpoint-every 4").code, 0);
  ASSERT_EQ(run("train --resume " + text("out") + " --iterations +10 --device cpu").code, 0);
  const SortedJson data = data_of("out");
  EXPECT_EQ(numbers(data.at("metrics").at("step")), (std::vector<int>{5, 10, 15, 20, 25, 30}));
  EXPECT_EQ(numbers(data.at("memory").at("step")), (std::vector<int>{5, 10, 15, 20, 25, 30}));
  EXPECT_EQ(data.at("results").at("iterations"), 30);
  if (can_write()) {
    EXPECT_TRUE(fs::exists(path("out/report.html.bak-1")));
  }
}

TEST_F(Report, OfAnExperimentHasMeansCurvesAndWaysToTheRuns) {
  write_scene(path("scene"));
  write_bytes(path("e.toml"),
              "output = 'out'\nscenes = ['scene']\nseeds = [1, 2]\n"
              "[set]\ntrain = {iterations = 10, device = 'cpu', threads = 1, log_every = 5}\n"
              "dataset = {eval = true, test_every = 3}\n");
  ASSERT_EQ(run("experiment " + text("e.toml") + " -q").code, 0);
  fs::rename(path("out"), path("moved"));
  const SortedJson data = data_of("moved"), results = json("moved/results.json");
  EXPECT_EQ(data.at("kind"), "experiment");
  EXPECT_EQ(data.at("title"), "e");
  EXPECT_EQ(data.at("summary"), results.at("summary"));
  ASSERT_EQ(data.at("runs").size(), 2u);
  const SortedJson& last = data.at("runs").at(1);
  EXPECT_EQ(last.at("results"), results.at("runs").at(1).at("results"));
  EXPECT_EQ(numbers(last.at("metrics").at("step")), (std::vector<int>{5, 10}));
  const std::string folder = "scene/" + last.at("config").get<std::string>() + "/seed2";
  if (can_write()) {
    EXPECT_EQ(last.at("report"), folder + "/report.html");
    EXPECT_TRUE(fs::exists(path("moved/report.html")));
  }
  write_bytes(path("moved/" + folder + "/metrics.csv"), "no,header\n");
  EXPECT_THAT(data_of("moved").at("notes").dump(), HasSubstr("metrics.csv"));
  write_bytes(path("moved/results.json"), "{\"experiment\": 1}");
  EXPECT_THAT(refusal("moved"), HasSubstr("--gather"));
}

TEST_F(Report, RefusesWhatIsNoRunAndNoExperiment) {
  EXPECT_EQ(run("report " + text("nowhere")).code, 2);
  fs::create_directories(path("empty"));
  EXPECT_THAT(refusal("empty"), AllOf(HasSubstr(text("empty")), HasSubstr("holds no run")));
}

}  // namespace
}  // namespace gs
