// SPDX-License-Identifier: Apache-2.0
// gemsplat edit as users run it.
#include <gmock/gmock.h>

#include <cmath>

#include "data_loaders/photos/photos.h"
#include "gs_core/system/text/json.h"
#include "gs_model/formats/formats.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class EditVerb : public Program {
 protected:
  void SetUp() override { train("run"); }
  Outcome edit(const std::string& more) {
    return run("edit " + text("run") + " " + more + " --device cpu");
  }
  std::size_t count(const std::string& name) { return read_model(path(name)).gaussians.count(); }
};

TEST_F(EditVerb, OperationsApplyInTheOrderOfTheCommandLineAndAreCounted) {
  const Outcome outcome = edit("--keep z=..4 --move 0,0,10 --keep z=13.5.. -o " + text("a.ply"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("--keep z=..4 "), HasSubstr("fewer"),
                                 HasSubstr("--move 0,0,10 "), HasSubstr("a.ply: ")));
  EXPECT_LT(outcome.out.find("--keep z=..4"), outcome.out.find("--move"));
  EXPECT_LT(outcome.out.find("--move"), outcome.out.find("--keep z=13.5.."));
  EXPECT_GT(count("a.ply"), 0u);
  for (const Vec3f& mean : read_model(path("a.ply")).gaussians.mean) {
    EXPECT_GE(mean.z, 13.5f);
    EXPECT_LE(mean.z, 14.0f);
  }
}

TEST_F(EditVerb, ADryRunWritesNothingAndJsonHasTheCounts) {
  const Outcome outcome =
      edit("--drop opacity=..0.1 --decimate 50 --sh-degree 0 --dry-run --json -o " + text("a.ply"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const auto json = SortedJson::parse(outcome.out);
  EXPECT_EQ(json["steps"].size(), 3u);
  EXPECT_EQ(json["steps"][0]["step"], "--drop opacity=..0.1");
  EXPECT_EQ(json["steps"][1]["after"], 50);
  EXPECT_EQ(json["gaussians"], 50);
  EXPECT_EQ(json["sh_degree"], 0);
  EXPECT_EQ(json["inputs"][0]["gaussians"], json["steps"][0]["before"]);
  EXPECT_FALSE(json.contains("output"));
  EXPECT_FALSE(fs::exists(path("a.ply")));
}

TEST_F(EditVerb, TheRunsCamerasChooseAndTestViewsAreNoTrainingViews) {
  const auto left = [&](const std::string& what) {
    const Outcome outcome = edit(what + " --dry-run --json");
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return SortedJson::parse(outcome.out)["gaussians"].get<int>();
  };
  EXPECT_GT(left("--keep seen=4"), 0);
  EXPECT_EQ(edit("--keep seen=5.. --dry-run").code, 2);  // six views, two of them held out
  EXPECT_GT(left("--keep view=view_0"), 0);
  EXPECT_LE(left("--keep view=view_0.png"), left("--keep view=all"));
}

TEST_F(EditVerb, FaintOnesGoAndTheCostIsMeasured) {
  const auto measured = [&](const std::string& more) {
    const Outcome outcome =
        edit("--drop opacity=..0.1 --measure --json --force -o " + text("a.ply") + " " + more);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return SortedJson::parse(outcome.out).at("measured");
  };
  const auto cost = measured("");
  EXPECT_EQ(cost["split"], "test");
  EXPECT_EQ(cost["before"]["num_gaussians"], count("run/point_cloud/iteration_20/point_cloud.ply"));
  EXPECT_EQ(cost["after"]["num_gaussians"], count("a.ply"));
  EXPECT_LT(cost["after"]["num_gaussians"], cost["before"]["num_gaussians"]);
  EXPECT_NE(cost["before"]["psnr"], cost["after"]["psnr"]);
  for (const float logit : read_model(path("a.ply")).gaussians.logit_opacity)
    EXPECT_GE(logit, std::log(0.1f / 0.9f) - 1e-5f);
  // What is behind half-transparent Gaussians counts, a lower degree is that of the result alone,
  // and a model that was moved is measured where the photos are.
  EXPECT_NE(measured("--set render.background=white")["before"]["psnr"], cost["before"]["psnr"]);
  EXPECT_EQ(measured("--sh-degree 0")["before"]["psnr"], cost["before"]["psnr"]);
  EXPECT_NEAR(measured("--turn 0,30,0 --move 5,0,0")["after"]["psnr"].get<double>(),
              cost["after"]["psnr"].get<double>(), 0.01);
  EXPECT_THAT(edit("--recenter --measure --dry-run").out,
              AllOf(HasSubstr("test views before: "), HasSubstr("test views after:  ")));
  const Outcome refused = run("edit " + text("a.ply") + " --recenter --measure --dry-run");
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("--data SCENE"));
}

TEST_F(EditVerb, WhatNoTrainingViewShowsGoesAndTrainingViewsStayAsTheyAre) {
  ASSERT_EQ(edit("--keep contribution=0.001.. -o " + text("a.ply")).code, 0);
  const auto psnr_of = [&](const std::string& model) {
    return SortedJson::parse(run("eval " + model + " --data " + text("scene") +
                                 " --test-every 3 --split train --json --device cpu")
                                 .out)["psnr"]
        .get<double>();
  };
  EXPECT_NEAR(psnr_of(text("a.ply")), psnr_of(text("run/point_cloud/iteration_20/point_cloud.ply")),
              0.01);
}

TEST_F(EditVerb, DroppingLeavesWhatContributesMost) {
  ASSERT_EQ(edit("--keep contribution=3.. -o " + text("a.ply")).code, 0);
  ASSERT_EQ(edit("--decimate " + std::to_string(count("a.ply")) + " --decimate-by drop -o " +
                 text("b.ply"))
                .code,
            0);
  EXPECT_TRUE(read_bytes(path("a.ply")) == read_bytes(path("b.ply")));
}

// The recipe of docs/guide/finetune.md: drop, recover without new Gaussians, export with codebooks.
TEST_F(EditVerb, ASmallerModelRecovers) {
  const Outcome outcome =
      edit("--decimate 0.3 --decimate-by drop --measure --json -o " + text("small.ply"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const auto small = SortedJson::parse(outcome.out)["measured"]["after"];
  const Outcome recovery =
      run("train " + text("scene") + " -o " + text("recovered") + " --from " + text("small.ply") +
          " -c finetune --iterations 60 --eval --test-every 3 --device cpu");
  ASSERT_EQ(recovery.code, 0) << recovery.err;
  const SortedJson recovered = json("recovered/results.json");
  EXPECT_LE(recovered["num_gaussians"], small["num_gaussians"]);
  EXPECT_GE(recovered["num_gaussians"].get<int>(), small["num_gaussians"].get<int>() - 5);
  EXPECT_GT(recovered["test"]["psnr"].get<double>(), small["psnr"].get<double>() + 1);
  const Outcome exported =
      run("export " + text("recovered") + " " + text("small.npz") + " --device cpu");
  EXPECT_EQ(exported.code, 0) << exported.err;
}

TEST_F(EditVerb, WhatPhotosLookThroughGoesAlsoWhereTheModelWasMoved) {
  const auto left = [&](const std::string& steps) {
    const Outcome outcome = edit(steps + " --dry-run --json");
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return SortedJson::parse(outcome.out)["gaussians"].get<int>();
  };
  const int all = left("--recenter"), some = left("--drop floaters=1,99");
  EXPECT_LT(some, all);
  EXPECT_EQ(left("--turn 0,90,0 --move 5,0,0 --drop floaters=1,99"), some);
  EXPECT_GE(left("--drop floaters=1"), some);  // one photo that shows it spares it
  for (const char* wrong : {"0", "2", "0.3,0", "0.3,1,1"})
    EXPECT_EQ(edit("--dry-run --drop floaters=" + std::string(wrong)).code, 2) << wrong;
}

TEST_F(EditVerb, OlderVerbsNameTheNewOnes) {
  for (const char* verb : {"prune", "merge", "convert-cameras"}) {
    const Outcome outcome = run(std::string(verb) + " " + text("run") + " -o " + text("a.ply"));
    EXPECT_EQ(outcome.code, 2) << verb;
    EXPECT_THAT(outcome.err, HasSubstr(std::string(verb) + "; here that is ")) << verb;
  }
}

TEST_F(EditVerb, ASceneOrAFileGivesTheCamerasOfAFileOfGaussians) {
  const std::string model = text("run/point_cloud/iteration_20/point_cloud.ply");
  const Outcome refused = run("edit " + model + " --keep seen=1.. --dry-run");
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("give --data SCENE or --cameras FILE"));
  const Outcome scene =
      run("edit " + model + " --keep seen=1.. --dry-run --device cpu --data " + text("scene"));
  const Outcome file = run("edit " + model + " --keep seen=1.. --dry-run --device cpu --cameras " +
                           text("run/cameras.json"));
  EXPECT_EQ(scene.code, 0) << scene.err;
  EXPECT_EQ(scene.out, file.out);
}

TEST_F(EditVerb, SeveralModelsAreMergedWhereTheyWereTrained) {
  ASSERT_EQ(edit("--turn 0,90,0 --keep x=4.. -o " + text("a.ply")).code, 0);
  ASSERT_EQ(edit("--keep z=..4 -o " + text("b.splat")).code, 0);
  const Outcome outcome =
      run("edit " + text("b.splat") + " " + text("a.ply") + " -o " + text("c.ply"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("2 models merged"));
  EXPECT_EQ(count("c.ply"), count("a.ply") + count("b.splat"));
  for (const Vec3f& mean : read_model(path("c.ply")).gaussians.mean) EXPECT_GT(mean.z, 2);
  const Outcome stored =
      run("edit " + text("b.splat") + " " + text("a.ply") + " --as-stored -o " + text("d.ply"));
  ASSERT_EQ(stored.code, 0) << stored.err;
  std::size_t far = 0;  // where the turn left them
  for (const Vec3f& mean : read_model(path("d.ply")).gaussians.mean) far += mean.x >= 4;
  EXPECT_EQ(far, count("a.ply"));
}

TEST_F(EditVerb, ModelsOfTwoScenesAreMergedWithAWarning) {
  const std::string both = "edit " + text("run") + " " + text("other");
  fs::copy(path("run"), path("other"), fs::copy_options::recursive);
  EXPECT_THAT(run(both + " -o " + text("a.ply")).err, Not(HasSubstr("two scenes")));
  std::string config = read_bytes(path("other/config.toml"));
  const std::string scene = path("scene").string();
  ASSERT_NE(config.find(scene), config.npos);
  write_bytes(path("other/config.toml"), config.replace(config.find(scene), scene.size(), "/else"));
  const Outcome outcome = run(both + " -o " + text("b.ply"));
  EXPECT_EQ(outcome.code, 0);
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("two scenes"), HasSubstr("--as-stored")));
  EXPECT_THAT(run(both + " --as-stored -o " + text("c.ply")).err, Not(HasSubstr("two scenes")));
}

TEST_F(EditVerb, AMovedFileSaysSoAndExportKeepsTheWayBack) {
  ASSERT_EQ(edit("--move 5,0,0 -o " + text("a.ply")).code, 0);
  EXPECT_EQ(json("a.ply.transforms.json")["was_moved"], true);
  ASSERT_EQ(run("export " + text("a.ply") + " " + text("b.glb")).code, 0);
  EXPECT_EQ(read_model(path("b.glb")).gaussians.mean[3],
            read_model(path("a.ply")).gaussians.mean[3]);
  EXPECT_NEAR(json("b.glb.transforms.json")["input_from_file"][0][3].get<double>(), -5, 1e-9);
  const std::string compared = " --data " + text("scene") + " --device cpu";
  EXPECT_THAT(run("eval " + text("b.glb") + compared).err,
              HasSubstr("was turned, scaled or moved"));
  ASSERT_EQ(edit("--keep z=..4 -o " + text("c.ply")).code, 0);
  EXPECT_THAT(run("eval " + text("c.ply") + compared).err, Not(HasSubstr("was turned")));
  EXPECT_FALSE(json("c.ply.transforms.json").contains("was_moved"));
}

// The lines of docs/guide/other_programs.md.
TEST_F(EditVerb, TurnsModelsForProgramsWhoseZOrYIsUp) {
  ASSERT_EQ(edit("--recenter -o " + text("up.ply")).code, 0);
  ASSERT_EQ(edit("--recenter --turn -90,0,0 -o " + text("z_up.ply")).code, 0);
  ASSERT_EQ(edit("--recenter --turn 180,0,0 -o " + text("y_up.ply")).code, 0);
  const GaussianModel model = read_model(path("up.ply")), z_up = read_model(path("z_up.ply")),
                      y_up = read_model(path("y_up.ply"));
  for (std::size_t i = 0; i < model.gaussians.count(); ++i) {
    EXPECT_NEAR(z_up.gaussians.mean[i].z, -model.gaussians.mean[i].y, 1e-5);
    EXPECT_NEAR(y_up.gaussians.mean[i].y, -model.gaussians.mean[i].y, 1e-5);
  }
}

TEST_F(EditVerb, APictureIsWrittenEvenInADryRun) {
  const Outcome outcome = edit("--keep z=..4 --dry-run --picture " + text("a.png"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Image8 picture = read_photo(path("a.png"));
  EXPECT_EQ(picture.width, 640 + 4 + 640);
  EXPECT_EQ(edit("--keep z=..4 --dry-run --picture " + text("a.png")).code, 2);  // it is there
  ASSERT_EQ(
      edit("--keep z=..4 --dry-run --force --picture-view view_3 --picture " + text("a.png")).code,
      0);
  EXPECT_EQ(read_photo(path("a.png")).width, 2 * kWidth + 4);
  EXPECT_TRUE(fs::exists(path("a.png.bak-1")));
}

TEST_F(EditVerb, APictureIsNotWrittenOverTheModel) {
  const Outcome same = edit("--recenter -o " + text("d.ply") + " --picture " + text("d.ply"));
  EXPECT_EQ(same.code, 2);
  EXPECT_THAT(same.err, HasSubstr("ends in .png"));
  EXPECT_FALSE(fs::exists(path("d.ply")));
  write_bytes(path("d.ply"), "older");
  fs::create_symlink(path("d.ply"), path("e.png"));
  const Outcome linked =
      edit("--recenter --force -o " + text("d.ply") + " --picture " + text("e.png"));
  EXPECT_EQ(linked.code, 2);
  EXPECT_THAT(linked.err, HasSubstr("named twice"));
  EXPECT_EQ(read_bytes(path("d.ply")), "older");
}

TEST_F(EditVerb, MistakesAreNamedBeforeTheWorkAndNothingIsOverwritten) {
  const auto refusal = [&](const std::string& more) {
    const Outcome outcome = edit(more);
    EXPECT_EQ(outcome.code, 2) << more;
    return outcome.err;
  };
  EXPECT_THAT(refusal("-o " + text("b.ply")), HasSubstr("there is nothing to do"));
  EXPECT_THAT(refusal("--recenter -o " + text("b.obj")), HasSubstr("does not write .obj"));
  EXPECT_THAT(refusal("--recenter -o " + text("b.gs4d")), HasSubstr("space and time"));
  EXPECT_THAT(refusal("--keep opacty=1 -o " + text("b.ply")), HasSubstr("did you mean opacity?"));
  EXPECT_THAT(refusal("--kep opacity=1 -o " + text("b.ply")), HasSubstr("did you mean --keep?"));
  EXPECT_THAT(refusal("--keep sphere=9,9,9,1 -o " + text("b.ply")),
              HasSubstr("no Gaussian is left after --keep sphere=9,9,9,1"));
  EXPECT_FALSE(fs::exists(path("b.ply")));
  write_bytes(path("a.ply"), "somebody's");
  EXPECT_THAT(refusal("--recenter -o " + text("a.ply")),
              AllOf(HasSubstr("a.ply is there already"), HasSubstr("--force")));
  ASSERT_EQ(edit("--recenter --force -o " + text("a.ply")).code, 0);
  EXPECT_EQ(read_bytes(path("a.ply.bak-1")), "somebody's");
}

TEST_F(EditVerb, TheHelpListsOperationsAndSelections) {
  const Outcome outcome = run("edit --help");
  EXPECT_EQ(outcome.code, 0);
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("--straighten"), HasSubstr("--decimate N|SHARE"),
                                 HasSubstr("sphere=X,Y,Z,RADIUS"), Not(HasSubstr("\n  y=LOW"))));
}

}  // namespace
}  // namespace gs
