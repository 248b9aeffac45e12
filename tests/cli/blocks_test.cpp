// SPDX-License-Identifier: Apache-2.0
// gemsplat partition, experiment and edit as users run them.
#include <gmock/gmock.h>

#include "gs_core/system/text/json.h"
#include "gs_model/formats/formats.h"
#include "tests/support/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class Blocks : public Program {
 protected:
  void SetUp() override { write_scene(path("scene"), true); }
  Outcome partition(const std::string& more = "") {
    return run("partition " + text("scene") + " -o " + text("parts") + kTrain + " " + more);
  }
  Outcome train_all() { return run("experiment " + text("parts/blocks.toml")); }
  Outcome merge(const std::string& more = "") {
    return run("edit " + text("parts") + " -o " + text("merged.ply") + " " + more);
  }
  std::string run_of(int block) const {
    return "parts/" + json("parts/blocks.json").at("blocks").at(block).at("run").get<std::string>();
  }
};

TEST_F(Blocks, AreTrainedByTheirExperimentAndMerged) {
  const Outcome divided = partition();
  ASSERT_EQ(divided.code, 0) << divided.err;
  EXPECT_THAT(divided.out, AllOf(HasSubstr("block0"), HasSubstr("block1"),
                                 HasSubstr("gemsplat experiment"), HasSubstr("gemsplat edit"),
                                 Not(HasSubstr("e+"))));  // Gaussians, "~120" and not "~1.2e+02"
  for (const char* file : {"blocks.json", "blocks.toml", "shared.toml", "block0.toml", "block0.txt",
                           "block1.toml", "block1.txt"})
    EXPECT_TRUE(fs::exists(path("parts") / file)) << file;
  EXPECT_EQ(merge().code, 3);  // nothing is trained yet
  const Outcome trained = train_all();
  ASSERT_EQ(trained.code, 0) << trained.err;
  const Outcome merged = merge("--json");
  ASSERT_EQ(merged.code, 0) << merged.err;
  const auto report = SortedJson::parse(merged.out);
  std::size_t kept = 0;
  for (const auto& block : report.at("inputs")) {
    EXPECT_GT(block.at("kept"), 0);
    EXPECT_LT(block.at("kept"), block.at("gaussians"));
    kept += block.at("kept").get<std::size_t>();
  }
  const GaussianModel model = read_model(path("merged.ply"));
  EXPECT_EQ(model.gaussians.count(), kept);
  EXPECT_EQ(report.at("gaussians"), kept);
  const Outcome measured =
      run("eval " + text("merged.ply") + " -d " + text("scene") + " --test-every 3 --device cpu");
  EXPECT_EQ(measured.code, 0) << measured.err;
  EXPECT_THAT(measured.out, HasSubstr("dB"));
}

TEST_F(Blocks, EachIsAnOrdinaryRunWithItsPhotosAndItsRegion) {
  ASSERT_EQ(partition().code, 0);
  // This scene is so small that each photo shows both blocks; one of them is left out by hand.
  std::string list = read_bytes(path("parts/block1.txt"));
  list.replace(list.find("view_4.png"), 10, "# nothing");
  write_bytes(path("parts/block1.txt"), list);
  const Outcome trained = run("train -c " + text("parts/block1.toml") + " -o " + text("mine"));
  ASSERT_EQ(trained.code, 0) << trained.err;
  EXPECT_THAT(trained.err, HasSubstr("5 of 6 photos"));
  const auto split = json("mine/split.json");
  EXPECT_EQ(split.at("train").size(), 3u);  // of the whole scene, views 1, 2, 4 and 5
  EXPECT_EQ(split.at("test").size(), 2u);
  EXPECT_THAT(read_bytes(path("mine/config.toml")),
              HasSubstr(json("parts/blocks.json").at("blocks").at(1).at("region")));

  ASSERT_EQ(run("train -c " + text("parts/block0.toml") + " -o " + text("other")).code, 0);
  const Outcome merged = merge("--run " + text("mine") + " --run " + text("other"));
  EXPECT_EQ(merged.code, 0) << merged.err;
}

TEST_F(Blocks, AStoppedBlockGoesOnAndIsNotMergedBefore) {
  ASSERT_EQ(partition().code, 0);
  ASSERT_EQ(train_all().code, 0);
  fs::remove(path(run_of(1)) / "results.json");
  const Outcome early = merge();
  EXPECT_EQ(early.code, 3);
  EXPECT_THAT(early.err, AllOf(HasSubstr("block1 is not finished"), HasSubstr("blocks.toml")));
  EXPECT_FALSE(fs::exists(path("merged.ply")));
  const Outcome again = train_all();
  ASSERT_EQ(again.code, 0) << again.err;
  EXPECT_THAT(again.err, HasSubstr("2 runs, 1 finished already"));
  EXPECT_EQ(merge().code, 0);
}

TEST_F(Blocks, StartFromACoarseModelAndKeepItWhereNoPhotoLooks) {
  ASSERT_EQ(run("train " + text("scene") + " -o " + text("coarse") + kTrain).code, 0);
  const Outcome divided = partition("--from " + text("coarse"));
  ASSERT_EQ(divided.code, 0) << divided.err;
  EXPECT_THAT(read_bytes(path("parts/shared.toml")),
              AllOf(HasSubstr(text("coarse")), HasSubstr("reset_opacity_until = 0")));
  ASSERT_EQ(train_all().code, 0);
  EXPECT_EQ(merge().code, 0);
}

TEST_F(Blocks, SlurmTrainsThemAsAnArray) {
  ASSERT_EQ(partition("--blocks 3").code, 0);
  const Outcome outcome = run("experiment " + text("parts/blocks.toml") + " --slurm --dry-run");
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(read_bytes(path("parts/runs/experiment.sbatch")), HasSubstr("--array=0-2"));
}

TEST_F(Blocks, NothingIsOverwrittenWithoutForce) {
  ASSERT_EQ(partition().code, 0);
  const std::string before = read_bytes(path("parts/blocks.json"));
  const Outcome refused = partition("--blocks 3");
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, AllOf(HasSubstr("is not empty"), HasSubstr("--force")));
  EXPECT_EQ(read_bytes(path("parts/blocks.json")), before);
  ASSERT_EQ(partition("--blocks 3 --force").code, 0);
  EXPECT_EQ(read_bytes(path("parts.bak-1/blocks.json")), before);
  EXPECT_EQ(json("parts/blocks.json").at("blocks").size(), 3u);
}

TEST_F(Blocks, ADryRunWritesNothing) {
  const Outcome outcome = run("partition " + text("scene") + " --dry-run --blocks 3");
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out,
              AllOf(HasSubstr("block2"), HasSubstr("the same command without --dry-run")));
  EXPECT_FALSE(fs::exists(path("parts")));
}

TEST_F(Blocks, ANameThatIsNotUtf8IsRefusedBeforeAnythingIsWritten) {
  const std::string name = text("p\xffrts");
  const Outcome output = run("partition " + text("scene") + " -o " + name + kTrain);
  EXPECT_EQ(output.code, 2);
  EXPECT_THAT(output.err, AllOf(HasSubstr("not UTF-8"), HasSubstr("-o"), Not(HasSubstr("json"))));
  EXPECT_FALSE(fs::exists(name));
  fs::rename(path("scene"), path("sc\xe9ne"));
  const Outcome scene = run("partition " + text("sc\xe9ne") + " -o " + text("parts") + kTrain);
  EXPECT_EQ(scene.code, 2);
  EXPECT_THAT(scene.err, AllOf(HasSubstr("dataset.source"), HasSubstr("not UTF-8")));
  EXPECT_FALSE(fs::exists(path("parts")));
}

TEST_F(Blocks, RefusalsNameTheRemedy) {
  EXPECT_THAT(run("partition").err, HasSubstr("gemsplat partition SCENE"));
  EXPECT_THAT(partition("--blocks 1000").err, HasSubstr("--blocks"));
  EXPECT_THAT(partition("--set density.region=1,0,0,2").err, HasSubstr("density.region"));
  EXPECT_FALSE(fs::exists(path("parts")));
  EXPECT_THAT(partition("--set photometric.model=gains").err, HasSubstr("dataset.exposure"));
  EXPECT_THAT(run("edit " + text("scene/blocks.json") + " -o " + text("m.ply")).err,
              HasSubstr("gemsplat partition"));
  EXPECT_THAT(run("edit " + text("scene") + " --run a --recenter -o " + text("m.ply")).err,
              HasSubstr("folder of its partition"));
}

}  // namespace
}  // namespace gs
