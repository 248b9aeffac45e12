// SPDX-License-Identifier: Apache-2.0
// The program as users run it: its output, files and exit codes, on the scene of
// tests/support/program.h.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <regex>
#include <sstream>

#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/photos.h"
#include "gs_core/system/text/json.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST_F(Program, PrintsItsVersionAndHelp) {
  const Outcome version = run("--version");
  EXPECT_TRUE(std::regex_match(version.out,
                               std::regex(R"(gemsplat \d+\.\d+\.\d+(, commit [0-9A-Za-z._-]+)?, )"
                                          R"((without CUDA|CUDA \d+[.\d]* for [0-9a-z, -]+)\n)")))
      << version.out;
  EXPECT_TRUE(run("info").out.starts_with(version.out)) << "both describe the build alike";
  const Outcome help = run("train --help");
  EXPECT_EQ(help.code, 0);
  EXPECT_THAT(help.out, AllOf(HasSubstr("--iterations"), HasSubstr("--max-steps"),
                              HasSubstr("number of photos;")));
}

// results.json of a run, `info` and `--version` take the commit from one place.
TEST_F(Program, TheVersionNamesTheCommitOfTheRunsProvenance) {
  ASSERT_EQ(train("out", "-q").code, 0);
  const std::string commit = json("out/results.json").at("commit");
  EXPECT_EQ(SortedJson::parse(run("info --json").out).at("commit"), commit);
  const std::string version = run("--version").out;
  if (commit == "unknown")  // built from a tree without .git
    EXPECT_THAT(version, Not(HasSubstr("commit")));
  else
    EXPECT_THAT(version, HasSubstr(", commit " + commit + ", "));
}

TEST_F(Program, PrintsTheResolvedConfigWithoutAScene) {
  const Outcome outcome = run("train --print-config --set density.every=77 -r 4");
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out,
              AllOf(HasSubstr("[density]"), HasSubstr("every = 77"), HasSubstr("resolution = 4")));
}

TEST_F(Program, SeveralGpusAreAskedForByOneFlag) {
  const Outcome shown = run("train --gpus 3 --print-config");
  EXPECT_THAT(shown.out, AllOf(HasSubstr("ranks = 3"), HasSubstr("batch = 3"),
                               HasSubstr("device = \"cuda\"")));
}

TEST_F(Program, SeveralProcessesOnTheCpuAreRefusedAndABatchScriptIsOne) {
  write_scene(path("scene"));
  const std::string train = "train " + text("scene") + " -o " + text("run") + kTrain;
  for (const std::string rank : {"0", "1"}) {
    const Outcome refused = run(train, "SLURM_PROCID=" + rank + " SLURM_STEP_NUM_TASKS=2 ");
    EXPECT_EQ(refused.code, 2);
    EXPECT_THAT(refused.err, HasSubstr("several processes train on GPUs only"));
  }
  const Outcome script = run(train, "SLURM_PROCID=0 SLURM_NTASKS=4 SLURM_JOB_ID=17 ");
  EXPECT_EQ(script.code, 0) << script.err;
}

TEST_F(Program, FlagsWinOverSetWhichWinsOverFiles) {
  write_bytes(path("a.toml"), "[train]\nseed = 1\niterations = 1\nlog_every = 1\n");
  write_bytes(path("b.toml"), "[train]\nlog_every = 2\n");
  const Outcome outcome =
      run("train --print-config --iterations 3 --set train.iterations=2 --set train.seed=2 -c " +
          text("a.toml") + " -c " + text("b.toml"));
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("iterations = 3"), HasSubstr("seed = 2"),
                                 HasSubstr("log_every = 2")));
}

TEST_F(Program, TakesUnderscoresHyphensAndTheNamesOfOtherTrainers) {
  for (const char* flags :
       {"--max_gaussians 9 --save_iterations 5 6", "--max-cap=9 --save-steps 5,6",
        "--cap_max=9 --save_steps=5,6", "--cap-max 9 --save-iterations 5 --save-steps 6"}) {
    const Outcome outcome = run(std::string("train --print-config ") + flags);
    EXPECT_EQ(outcome.code, 0) << flags << ": " << outcome.err;
    EXPECT_THAT(outcome.out,
                AllOf(HasSubstr("max_gaussians = 9"), HasSubstr("save_steps = [5, 6]")))
        << flags;
  }
  EXPECT_THAT(
      run("train --print-config -s a -m b -w --antialiasing --iter 5 --test_iterations 3").out,
      AllOf(HasSubstr("source = \"a\""), HasSubstr("output = \"b\""),
            HasSubstr("background = \"white\""), HasSubstr("antialias = true"),
            HasSubstr("iterations = 5"), HasSubstr("test_steps = [3]")));
}

TEST_F(Program, SceneFarFromTheOriginKeepsItsOffsetBesideTheModel) {
  write_scene(path("scene"));
  std::istringstream images(read_bytes(path("scene/sparse/0/images.txt")));
  std::ostringstream moved;  // moved by 500,000 along x; no camera is rotated
  moved.precision(12);
  for (std::string line; std::getline(images, line);) {
    std::istringstream words(line);
    double id, w, x, y, z, tx;
    if (words >> id >> w >> x >> y >> z >> tx) {
      std::string rest;
      std::getline(words, rest);
      moved << id << " 1 0 0 0 " << tx - 500000 << rest << "\n\n";
    }
  }
  write_bytes(path("scene/sparse/0/images.txt"), moved.str());
  fs::remove(path("scene/sparse/0/points3D.txt"));
  ASSERT_EQ(train("out").code, 0);
  const SortedJson offset = json("out/world_offset.json").at("world_offset");
  EXPECT_NEAR(offset[0], 500000, 1);
  EXPECT_EQ(json("out/results.json").at("world_offset"), offset);
  EXPECT_LT(std::abs(json("out/cameras.json")[0].at("position")[0].get<double>()), 1);
  const Outcome again = run("eval " + text("out") + " --device cpu --json");
  EXPECT_NEAR(SortedJson::parse(again.out).at("psnr"),
              json("out/results.json").at("test").at("psnr"), 1e-6);

  // as a user has them, in the photos' own coordinates
  SortedJson cameras = json("out/cameras.json");
  for (auto& camera : cameras)
    camera["position"][0] = camera["position"][0].get<double>() + offset[0].get<double>();
  write_bytes(path("own.json"), cameras.dump());
  ASSERT_EQ(run("render " + text("out") + " --device cpu -o " + text("a")).code, 0);
  ASSERT_EQ(run("render " + text("out") + " --device cpu -o " + text("b") + " --cameras " +
                text("own.json"))
                .code,
            0);
  const auto a = read_photo(path("a/view_1.png")), b = read_photo(path("b/view_1.png"));
  int most = 0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i)
    most = std::max(most, std::abs(int(a.pixels[i]) - int(b.pixels[i])));
  EXPECT_LE(most, 1);
}

TEST_F(Program, UnknownFlagsKeysAndVerbsAreUsageErrorsThatNameTheNearest) {
  const Outcome flag = run("train scene -o out --iteratons 5");
  EXPECT_EQ(flag.code, 2);
  EXPECT_THAT(flag.err, AllOf(HasSubstr("--iteratons"), HasSubstr("did you mean --iterations?")));
  const Outcome key = run("train scene -o out --set train.sed=5");
  EXPECT_EQ(key.code, 2);
  EXPECT_THAT(key.err, HasSubstr("did you mean train.seed?"));
  const Outcome verb = run("trian scene");
  EXPECT_EQ(verb.code, 2);
  EXPECT_THAT(verb.err, HasSubstr("did you mean train?"));
  EXPECT_THAT(verb.err, HasSubstr("there is no command trian"));
  EXPECT_THAT(run("train scene more -o out").err,
              HasSubstr("gemsplat train takes no further argument more"));
  write_bytes(path("photos/1.jpg"), "");
  write_bytes(path("photos/2.jpg"), "");
  for (const char* verb : {"reconstruct", "train"})
    EXPECT_THAT(
        run(std::string(verb) + " " + text("photos") + "/*.jpg -o " + text("o")).err,
        HasSubstr("name the folder that holds the photos, " + path("photos").string() + "/"));
  const Outcome nothing = run("");
  EXPECT_EQ(nothing.code, 2);
  EXPECT_THAT(nothing.err, HasSubstr("a command is missing"));
  EXPECT_EQ(run("train").code, 2);
  EXPECT_EQ(run("train scene").code, 3);  // there is no scene; the run has a folder by default
  EXPECT_EQ(run("train scene -o out --iterations -1").code, 2);
}

TEST_F(Program, AMissingSceneIsOneLineAndLeavesNoFolderBehind) {
  const Outcome outcome = run("train " + text("nowhere") + " -q --device cpu -o " + text("out"));
  EXPECT_EQ(outcome.code, 3);
  EXPECT_THAT(outcome.err, HasSubstr("nowhere"));
  EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  EXPECT_FALSE(fs::exists(path("out")));
}

TEST_F(Program, ABuildWithoutCudaSaysSo) {
  if (SortedJson::parse(run("info --json").out).at("CUDA").at("available") == true)
    GTEST_SKIP() << "this machine has a GPU";
  write_scene(path("scene"));
  const Outcome outcome = run("train " + text("scene") + " --device cuda -o " + text("out"));
  EXPECT_EQ(outcome.code, 3);
  EXPECT_THAT(outcome.err, HasSubstr("--device cpu"));
}

TEST_F(Program, TrainingWritesTheWholeFolder) {
  const Outcome outcome = train("out", "--save-steps 10 --test-steps 7");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out,
              AllOf(HasSubstr("PSNR"), HasSubstr("point_cloud.ply"), HasSubstr("comparison.png")));
  for (const char* name :
       {"point_cloud/iteration_10/point_cloud.ply", "point_cloud/iteration_20/point_cloud.ply",
        "input.ply", "test/ours_20/renders/00000.png", "test/ours_20/renders/00001.png",
        "test/ours_20/gt/00001.png", "comparison.png"})
    EXPECT_TRUE(fs::exists(path("out") / name)) << name;
  EXPECT_EQ(json("out/cameras.json").size(), std::size_t(kViews));

  const SortedJson results = json("out/results.json");
  EXPECT_EQ(results.at("iterations"), 20);
  EXPECT_GT(results.at("num_gaussians"), 0);
  EXPECT_GT(results.at("train_seconds"), 0.0);
  double seconds = 0;
  for (const auto& [part, took] : results.at("wall_seconds").items()) seconds += took.get<double>();
  EXPECT_GT(seconds, results.at("train_seconds").get<double>());
  EXPECT_EQ(results.at("test").at("num_views"), 2);
  EXPECT_GT(results.at("test").at("psnr"), 5.0);
  EXPECT_EQ(results.at("train").at("num_views"), 4);
  EXPECT_EQ(results.at("device"), "cpu");
  EXPECT_EQ(results.at("seed"), 42);
  EXPECT_EQ(results.at("scene_hash").get<std::string>().size(), 16u);
  EXPECT_GT(results.at("peak_host_bytes"), 1 << 20);
  for (const char* key : {"version", "commit", "compiler", "cpu", "date"})
    EXPECT_FALSE(results.at(key).get<std::string>().empty()) << key;
  EXPECT_EQ(results.size(), 16u + results.contains("cuda") + results.contains("uncommitted"));

  const SortedJson split = json("out/split.json");
  EXPECT_EQ(split.at("test"), SortedJson({"view_0.png", "view_3.png"}));
  EXPECT_EQ(split.at("train").size(), 4u);
  EXPECT_TRUE(json("out/per_view.json").at("test").contains("view_3.png"));

  EXPECT_THAT(read_bytes(path("out/cfg_args")),
              AllOf(HasSubstr("Namespace(sh_degree=3, source_path='" + text("scene") + "'"),
                    HasSubstr("images='images'"), HasSubstr("resolution=-1"),
                    HasSubstr("white_background=False"), HasSubstr("eval=True)")));
  EXPECT_THAT(read_bytes(path("out/config.toml")), HasSubstr("iterations = 20"));
}

TEST_F(Program, TrainingSaysHowLongItTakesHereAndThatItEvaluates) {
  const Outcome outcome = train("out", "--iterations 200");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.err,
              AllOf(HasSubstr("50 steps took "), HasSubstr(" s here: the other 150 take about "),
                    HasSubstr("now it is evaluated")));
  EXPECT_THAT(train("brief").err, Not(HasSubstr("steps took")));
}

TEST_F(Program, OnlyARunThatGrowsSaysThatGaussiansAreAdded) {
  EXPECT_THAT(train("out", "--iterations 400").err, HasSubstr("Gaussians are added"));
  const Outcome outcome = train("on", "--from " + text("out") + " -c finetune --iterations 120");
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("50 steps took "), Not(HasSubstr("are added"))));
}

TEST_F(Program, TheForecastOfARunFromAModelComesWhenItsGaussiansAreCounted) {
  ASSERT_EQ(train("out").code, 0);
  const std::string err = train("on", "--from " + text("out")).err;
  const std::size_t forecast = err.find("forecast: ");
  ASSERT_NE(forecast, err.npos) << err;
  EXPECT_EQ(err.find("forecast: ", forecast + 1), err.npos) << err;
  EXPECT_LT(err.find("training starts from the "), forecast) << err;
}

TEST_F(Program, ADynamicRunOfPhotosWithoutTimesIsWarnedOf) {
  EXPECT_THAT(train("out", "-c dynamic").err, HasSubstr("the photos have no times"));
}

TEST_F(Program, MetricsHaveARowForEachIntervalAndEachEvaluation) {
  ASSERT_EQ(train("out", "--test-steps 7").code, 0);
  std::istringstream file(read_bytes(path("out/metrics.csv")));
  std::string line;
  std::getline(file, line);
  EXPECT_EQ(line, "step,loss,num_gaussians,seconds,steps_per_second,sh_degree,test_psnr,test_ssim");
  std::vector<int> steps;
  std::vector<bool> evaluated;
  while (std::getline(file, line)) {
    EXPECT_EQ(std::count(line.begin(), line.end(), ','), 7) << line;
    steps.push_back(std::stoi(line));
    evaluated.push_back(!line.ends_with(",,"));
  }
  EXPECT_EQ(steps, (std::vector<int>{5, 7, 10, 15, 20}));
  EXPECT_EQ(evaluated, (std::vector<bool>{false, true, false, false, true}));
}

TEST_F(Program, TrainingWithoutHeldOutViewsHasNoTestFigures) {
  write_scene(path("scene"));
  const Outcome outcome =
      run("train " + text("scene") + " -o " + text("out") + " -i 3 --device cpu");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("not measured; --eval"));
  for (const char* split : {"test", "train"})
    EXPECT_TRUE(json("out/results.json").at(split).is_null()) << split;
  EXPECT_TRUE(fs::exists(path("out/comparison.png")));
  EXPECT_TRUE(fs::exists(path("out/train/ours_3/renders/00000.png")));
  EXPECT_FALSE(fs::exists(path("out/test")));
}

TEST_F(Program, QuietPrintsNothing) {
  const Outcome outcome = train("out", "-q");
  EXPECT_EQ(outcome.code, 0);
  EXPECT_EQ(outcome.out + outcome.err, "");
}

TEST_F(Program, AnExistingRunIsRefusedAndIntact) {
  ASSERT_EQ(train("out").code, 0);
  const std::string before = read_bytes(path("out/results.json"));
  const Outcome again = train("out", "--seed 1");
  EXPECT_EQ(again.code, 2);
  EXPECT_THAT(again.err, AllOf(HasSubstr(text("out")), HasSubstr("--resume goes on with it"),
                               HasSubstr("-o"), HasSubstr("--force")));
  EXPECT_EQ(read_bytes(path("out/results.json")), before);
}

TEST_F(Program, ForceMovesTheOldRunAside) {
  ASSERT_EQ(train("out").code, 0);
  const std::string before = read_bytes(path("out/results.json"));
  ASSERT_EQ(train("out", "--force --seed 1").code, 0);
  ASSERT_EQ(train("out", "--force --seed 2").code, 0);
  EXPECT_EQ(read_bytes(path("out.bak-1/results.json")), before);
  EXPECT_EQ(json("out.bak-2/results.json").at("seed"), 1);
  EXPECT_EQ(json("out/results.json").at("seed"), 2);
}

TEST_F(Program, TheSameSeedWritesTheSameBytesWithOneThreadAndWithTwo) {
  const auto ply = [&](const std::string& name) {
    return read_bytes(path(name) / "point_cloud/iteration_20/point_cloud.ply");
  };
  ASSERT_EQ(train("one", "--threads 1").code, 0);
  ASSERT_EQ(train("two", "--threads 2").code, 0);
  ASSERT_EQ(train("again", "--threads 2").code, 0);
  ASSERT_EQ(train("other", "--threads 1 --seed 9").code, 0);
  EXPECT_FALSE(ply("one").empty());
  EXPECT_TRUE(ply("one") == ply("two"));
  EXPECT_TRUE(ply("two") == ply("again"));
  EXPECT_FALSE(ply("one") == ply("other"));
}

TEST_F(Program, AWrittenConfigRepeatsTheRun) {
  ASSERT_EQ(train("out").code, 0);
  ASSERT_EQ(run("train -c " + text("out/config.toml") + " -o " + text("repeated")).code, 0);
  const std::string ply = "/point_cloud/iteration_20/point_cloud.ply";
  EXPECT_TRUE(read_bytes(text("out") + ply) == read_bytes(text("repeated") + ply));
}

TEST_F(Program, MasksCountInTrainingEvaluationAndDoctor) {
  write_scene(path("scene"));
  Image8 mask(kWidth, kHeight, 1);
  std::fill_n(mask.pixels.begin(), mask.pixels.size() / 4, std::uint8_t(255));
  for (int v = 0; v < kViews; ++v)
    write_png(path("scene") / "masks" / ("view_" + std::to_string(v) + ".png"), mask);
  const Outcome trained = train("masked");
  ASSERT_EQ(trained.code, 0) << trained.err;
  EXPECT_THAT(trained.out + trained.err,
              HasSubstr("6 of 6 photos are masked: 25.0 % of their pixels train"));
  const Outcome turned = train("turned", "--invert-masks");
  EXPECT_THAT(turned.out + turned.err, HasSubstr("75.0 % of their pixels train"));
  const Outcome over = train("over", "--mask-mode background --background random");
  EXPECT_THAT(over.out + over.err, HasSubstr("25.0 % of their pixels show the scene"));
  EXPECT_THAT(train("none", "--masks none").out, Not(HasSubstr("masked")));
  EXPECT_NE(read_bytes(path("masked/point_cloud/iteration_20/point_cloud.ply")),
            read_bytes(path("none/point_cloud/iteration_20/point_cloud.ply")));

  ASSERT_EQ(run("eval " + text("masked") + " -o " + text("eval.json")).code, 0);
  ASSERT_EQ(run("eval " + text("masked") + " --masks none -o " + text("all.json")).code, 0);
  EXPECT_NEAR(json("eval.json").at("psnr").get<double>(),
              json("masked/results.json").at("test").at("psnr").get<double>(), 0.01);
  EXPECT_NE(json("eval.json").at("psnr"), json("all.json").at("psnr"));
  EXPECT_THAT(run("doctor " + text("scene") + " --invert-masks").out,
              HasSubstr("75.0 % of their pixels train"));
  EXPECT_EQ(run("train " + text("scene") + " -o x --mask-mode both").code, 2);
}

TEST_F(Program, EvalOfARunFindsTheFiguresOfItsTraining) {
  ASSERT_EQ(train("out").code, 0);
  const Outcome outcome = run("eval " + text("out") + " --json -q --device cpu");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const SortedJson figures = SortedJson::parse(outcome.out);
  const SortedJson expected = json("out/results.json").at("test");
  // The PLY holds rotations of length 1, so pictures agree up to rounding only.
  EXPECT_NEAR(figures.at("psnr").get<double>(), expected.at("psnr").get<double>(), 0.01);
  for (const char* key : {"ssim", "flip"})
    EXPECT_NEAR(figures.at(key).get<double>(), expected.at(key).get<double>(), 0.001) << key;
  EXPECT_GT(expected.at("flip"), 0);
  for (const auto& [name, view] : json("out/per_view.json").at("test").items())
    EXPECT_NEAR(figures.at("views").at(name).at("flip"), view.at("flip"), 0.001) << name;
  EXPECT_FALSE(
      json("out/results.json").at("train").contains("flip"));  // only of the views that count
  EXPECT_EQ(figures.at("views").size(), 2u);

  const Outcome of_ply = run("eval " + text("out/point_cloud/iteration_20/point_cloud.ply") +
                             " --data " + text("scene") + " --test-every 3 --device cpu");
  EXPECT_EQ(of_ply.code, 0) << of_ply.err;
  EXPECT_THAT(of_ply.out, AllOf(HasSubstr("over 2 views"), HasSubstr(" FLIP")));
  EXPECT_EQ(run("eval " + text("out/point_cloud/iteration_20/point_cloud.ply")).code, 2);
  const Outcome panned = run("eval " + text("out") + " --json -q --device cpu --popping");
  const SortedJson popping = SortedJson::parse(panned.out).at("popping");
  EXPECT_GT(popping.at("flip_seventh"), popping.at("flip_next"));
  EXPECT_FALSE(SortedJson::parse(outcome.out).contains("popping"));
  EXPECT_EQ(run("eval " + text("out") + " --iteration 19").code, 3);
}

TEST_F(Program, RenderOfARunRepeatsItsTestPictures) {
  ASSERT_EQ(train("out").code, 0);
  const Outcome outcome = run("render " + text("out") + " --device cpu -o " + text("pictures"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Image8 rendered = read_photo(path("pictures/view_0.png"));
  const Image8 expected = read_photo(path("out/test/ours_20/renders/00000.png"));
  ASSERT_EQ(rendered.pixels.size(), expected.pixels.size());
  for (std::size_t i = 0; i < rendered.pixels.size(); ++i)
    ASSERT_NEAR(rendered.pixels[i], expected.pixels[i], 1) << i;  // rotations, as above
  EXPECT_TRUE(fs::exists(path("pictures/view_5.png")));
  ASSERT_EQ(run("render " + text("out") + " --split test -o " + text("test")).code, 0);
  EXPECT_TRUE(fs::exists(path("test/view_3.png")));
  EXPECT_FALSE(fs::exists(path("test/view_5.png")));
}

TEST_F(Program, RenderTakesACameraFileOrASceneAndASmallerSize) {
  ASSERT_EQ(train("out").code, 0);
  const std::string ply = text("out/point_cloud/iteration_20/point_cloud.ply");
  ASSERT_EQ(run("render " + ply + " --cameras " + text("out/cameras.json") + " -r 2 -w -o " +
                text("half"))
                .code,
            0);
  EXPECT_EQ(read_photo_size(path("half/view_1.png")).width, kWidth / 2);
  ASSERT_EQ(
      run("render " + ply + " --data " + text("scene") + " --split test -o " + text("test")).code,
      0);
  EXPECT_TRUE(fs::exists(path("test/view_0.png")));
  EXPECT_FALSE(fs::exists(path("test/view_1.png")));
  EXPECT_EQ(run("render " + ply + " -o " + text("none")).code, 2);
  EXPECT_EQ(run("render " + text("absent.ply") + " -o " + text("none")).code, 3);
}

TEST_F(Program, PicturesKeepDotsAndFoldersOfTheirNames) {
  ASSERT_EQ(train("out").code, 0);
  SortedJson cameras = json("out/cameras.json");
  cameras = {cameras[0], cameras[1], cameras[2]};
  cameras[0]["img_name"] = "left/frame.7";
  cameras[1]["img_name"] = "left/frame.8.JPG";
  cameras[2]["img_name"] = "../../outside";
  write_bytes(path("named.json"), cameras.dump());
  ASSERT_EQ(
      run("render " + text("out") + " --cameras " + text("named.json") + " -o " + text("pictures"))
          .code,
      0);
  EXPECT_TRUE(fs::exists(path("pictures/left/frame.7.png")));
  EXPECT_TRUE(fs::exists(path("pictures/left/frame.8.png")));
  EXPECT_TRUE(fs::exists(path("pictures/outside.png")));
}

TEST_F(Program, InfoDescribesAModelAndTheBuild) {
  ASSERT_EQ(train("out").code, 0);
  const Outcome model = run("info " + text("out") + " --json");
  ASSERT_EQ(model.code, 0) << model.err;
  EXPECT_EQ(SortedJson::parse(model.out).at("count"), json("out/results.json").at("num_gaussians"));
  EXPECT_EQ(run("info " + text("out/point_cloud/iteration_20/point_cloud.ply")).code, 0);
  EXPECT_EQ(run("info " + text("scene")).code, 3);
  EXPECT_THAT(run("info").out,
              AllOf(HasSubstr("CUDA"), HasSubstr("OpenImageIO"), HasSubstr("OpenCV")));
}

TEST_F(Program, DoctorSaysWhetherTrainingCanStart) {
  write_scene(path("scene"));
  const Outcome good = run("doctor " + text("scene") + " -q");
  EXPECT_EQ(good.code, 0) << good.err;
  EXPECT_THAT(good.out, HasSubstr("training can start"));
  std::filesystem::create_directories(path("empty"));
  const Outcome bad = run("doctor " + text("empty") + " --json");
  EXPECT_EQ(bad.code, 3);
  const auto json = SortedJson::parse(bad.out);
  EXPECT_EQ(json.at("can_train"), false);
  EXPECT_EQ(json.at("findings").at(0).at("level"), "fatal");
  EXPECT_EQ(run("doctor").code, 2);
}

TEST_F(Program, ASignalSavesTheModelAndIsTold) {
  write_scene(path("scene"));
  const std::string arguments =
      "train " + text("scene") + " -q --device cpu -i 1000000 -o " + text("out");
  const std::string script = std::string(GS_PROGRAM) + " " + arguments + " 2>" + text("err.txt") +
                             " & pid=$!; until grep -q ^100, " + text("out/metrics.csv") +
                             " 2>/dev/null; do sleep 0.05; done; kill -TERM $pid; wait $pid";
  const int status = std::system(("timeout 60 sh -c '" + script + "'").c_str());
  EXPECT_EQ(WEXITSTATUS(status), 5) << read_bytes(path("err.txt"));
  EXPECT_THAT(read_bytes(path("err.txt")), HasSubstr("point_cloud.ply"));
  EXPECT_EQ(run("info " + text("out")).code, 0);
}

}  // namespace
}  // namespace gs
