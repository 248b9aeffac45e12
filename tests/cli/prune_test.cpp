// SPDX-License-Identifier: Apache-2.0
// gemsplat prune as users run it.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "gs_core/math/render/activations.h"
#include "gs_core/system/text/json.h"
#include "gs_model/formats/ply/ply.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

class Prune : public Program {
 protected:
  void SetUp() override { train("run"); }
  Outcome prune(const std::string& more) {
    return run("prune " + text("run") + " " + more + " --device cpu");
  }
  GaussianModel trained() const {
    return read_gaussian_ply(path("run/point_cloud/iteration_20/point_cloud.ply"));
  }
};

TEST_F(Prune, FaintOnesGoAndTheCostIsSaid) {
  const GaussianModel before = trained();
  std::vector<float> opacities;
  for (const float logit : before.gaussians.logit_opacity) opacities.push_back(sigmoid(logit));
  std::nth_element(opacities.begin(), opacities.begin() + 50, opacities.end());
  const Outcome outcome =
      prune("--opacity " + std::to_string(opacities[50]) + " -o " + text("a.ply") + " --json");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const auto json = SortedJson::parse(outcome.out);
  const GaussianModel after = read_gaussian_ply(path("a.ply"));
  EXPECT_NEAR(double(before.gaussians.count() - after.gaussians.count()), 50, 1);
  EXPECT_EQ(json["before"]["num_gaussians"], before.gaussians.count());
  EXPECT_EQ(json["after"]["num_gaussians"], after.gaussians.count());
  EXPECT_EQ(json["split"], "test");
  EXPECT_NE(json["before"]["psnr"], json["after"]["psnr"]);
  for (const float logit : after.gaussians.logit_opacity)
    EXPECT_GE(sigmoid(logit), opacities[50] - 1e-5f);
}

TEST_F(Prune, WhatNoTrainingViewShowsGoesAndTrainingViewsStayAsTheyAre) {
  ASSERT_EQ(prune("--contribution 0.001 -o " + text("a.ply")).code, 0);
  const auto psnr_of = [&](const std::string& model) {
    return SortedJson::parse(run("eval " + model + " --data " + text("scene") +
                                 " --test-every 3 --split train --json --device cpu")
                                 .out)["psnr"]
        .get<double>();
  };
  EXPECT_NEAR(psnr_of(text("a.ply")), psnr_of(text("run/point_cloud/iteration_20/point_cloud.ply")),
              0.01);
}

TEST_F(Prune, AShareOfTheGaussiansIsKeptThatContributesMost) {
  const std::size_t all = trained().gaussians.count();
  const auto left = [&](const std::string& name, const std::string& rules) {
    const Outcome outcome = prune(rules + " --json -o " + text(name));
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    const auto json = SortedJson::parse(outcome.out);
    EXPECT_EQ(json["removed"]["unseen"].get<std::size_t>(),
              all - json["after"]["num_gaussians"].get<std::size_t>());
    return json["after"];
  };
  const auto best = left("a.ply", "--keep 0.25");
  EXPECT_EQ(best["num_gaussians"], std::size_t(std::llround(0.25 * double(all))));
  // What --contribution leaves is among the best, at any number of them.
  const auto seen = left("b.ply", "--contribution 3");
  const double share = (double(seen["num_gaussians"].get<std::size_t>()) + 0.1) / double(all);
  left("c.ply", "--keep " + std::to_string(share));
  EXPECT_TRUE(read_bytes(path("b.ply")) == read_bytes(path("c.ply")));
}

// The recipe of docs/guide/finetune.md: prune, then recover without new Gaussians.
TEST_F(Prune, APrunedModelRecovers) {
  const Outcome outcome = prune("--keep 0.3 --json -o " + text("small.ply"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const auto pruned = SortedJson::parse(outcome.out)["after"];
  const Outcome recovery =
      run("train " + text("scene") + " -o " + text("recovered") + " --from " + text("small.ply") +
          " -c finetune --iterations 60 --eval --test-every 3 --device cpu");
  ASSERT_EQ(recovery.code, 0) << recovery.err;
  const SortedJson recovered = json("recovered/results.json");
  EXPECT_LE(recovered["num_gaussians"], pruned["num_gaussians"]);
  EXPECT_GE(recovered["num_gaussians"].get<int>(), pruned["num_gaussians"].get<int>() - 5);
  EXPECT_GT(recovered["test"]["psnr"].get<double>(), pruned["psnr"].get<double>() + 1);
}

TEST_F(Prune, OutsideTheBoxNothingIsLeft) {
  ASSERT_EQ(prune("--box 1 1 4 -1 -1 -1 -o " + text("a.ply")).code, 0);
  const GaussianModel after = read_gaussian_ply(path("a.ply"));
  EXPECT_LT(after.gaussians.count(), trained().gaussians.count());
  for (const Vec3f& mean : after.gaussians.mean)
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_GE(mean[axis], -1);
      EXPECT_LE(mean[axis], axis == 2 ? 4 : 1);
    }
}

// A white background changes how half-transparent Gaussians look, and thereby the PSNR.
TEST_F(Prune, RenderingFlagsCount) {
  const auto psnr_with = [&](const std::string& name, const std::string& flags) {
    const Outcome outcome = prune("--opacity 0.01 --json -o " + text(name) + " " + flags);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return SortedJson::parse(outcome.out)["before"]["psnr"].get<double>();
  };
  const double plain = psnr_with("a.ply", "");
  EXPECT_NE(psnr_with("b.ply", "-w"), plain);
  EXPECT_NE(psnr_with("c.ply", "--antialiased"), plain);
  EXPECT_NE(psnr_with("d.ply", "--set render.background=white"), plain);
  EXPECT_EQ(psnr_with("e.ply", "--sh-degree 0"), plain);  // that of the result, not of "before"
}

TEST_F(Prune, AnEmptyModelIsWrittenOnlyIfAskedFor) {
  const Outcome refused = prune("--opacity 1 -o " + text("a.ply"));
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, AllOf(HasSubstr("nothing would be left"), HasSubstr("--allow-empty")));
  EXPECT_FALSE(fs::exists(path("a.ply")));
  EXPECT_EQ(prune("--opacity 1 --allow-empty -o " + text("a.ply")).code, 0);
  EXPECT_EQ(read_gaussian_ply(path("a.ply")).gaussians.count(), 0u);
}

TEST_F(Prune, ALowerShDegreeIsWrittenAndNothingElseChanges) {
  ASSERT_EQ(prune("--sh-degree 0 -o " + text("a.ply")).code, 0);
  const GaussianModel before = trained(), after = read_gaussian_ply(path("a.ply"));
  EXPECT_EQ(before.sh_degree, 3);
  EXPECT_EQ(after.sh_degree, 0);
  EXPECT_EQ(after.gaussians.sh0.download(), before.gaussians.sh0.download());
}

TEST_F(Prune, NothingIsOverwrittenAndNothingAskedIsAnError) {
  write_bytes(path("a.ply"), "somebody's");
  const Outcome refused = prune("--opacity 0.1 -o " + text("a.ply"));
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, AllOf(HasSubstr("a.ply is there already"), HasSubstr("--force")));
  EXPECT_EQ(prune("--opacity 0.1 --force -o " + text("a.ply")).code, 0);
  EXPECT_EQ(read_bytes(path("a.ply.bak-1")), "somebody's");
  const Outcome nothing = prune("-o " + text("b.ply"));
  EXPECT_EQ(nothing.code, 2);
  EXPECT_THAT(nothing.err, HasSubstr("--contribution"));
  EXPECT_EQ(prune("--opacity 0.1 -o " + text("b.obj")).code, 2);
}

}  // namespace
}  // namespace gs
