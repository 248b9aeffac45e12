// SPDX-License-Identifier: Apache-2.0
// gemsplat export --lod as users run it, and other verbs on what it wrote.
#include <gmock/gmock.h>

#include "gs_core/system/text/json.h"
#include "gs_model/formats/ply/ply.h"
#include "tests/support/program.h"
#include "tests/support/random_model.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

class ExportLod : public Program {
 protected:
  void SetUp() override {
    const auto build = SortedJson::parse(run("info --json").out);
    for (const char* library : {"zlib", "libwebp"})
      if (!build[library]["available"].get<bool>()) GTEST_SKIP() << "this build has no " << library;
    write_scene(path("scene"));
    GaussianModel model = random_model(4000, 1);
    for (std::size_t i = 0; i < 4000; ++i) {
      model.gaussians.mean[i] = Vec3f(0.5f, 0.5f, 1) * model.gaussians.mean[i] + Vec3f(0, 0, 5);
      model.gaussians.log_scale[i] -= Vec3f(3);
      for (Vec3f& c : model.gaussians.sh_rest[i].coefficient) c *= 0.1f;  // no palette fits more
    }
    write_gaussian_ply(path("model.ply"), model);
  }
  Outcome export_lod(const std::string& more) {
    return run("export " + text("model.ply") + " --lod --device cpu " + more);
  }
};

TEST_F(ExportLod, WritesLevelsWithATableOfWhatTheyCost) {
  const Outcome outcome =
      export_lod(text("lod") + " --lod-leaf 600 --test-every 3 --data " + text("scene"));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const std::string table = read_bytes(path("lod/levels.md"));
  EXPECT_TRUE(outcome.out.starts_with(table)) << outcome.out;
  EXPECT_THAT(table, AllOf(HasSubstr("| 0 | 4000 |"), HasSubstr("| 1 | 1000 |"),
                           HasSubstr("| 2 | 256 |"), HasSubstr("| model.rad |")));
  const auto meta = json("lod/lod-meta.json");
  EXPECT_EQ(meta["lodLevels"], 3);
  EXPECT_TRUE(meta["tree"].contains("children"));
  const auto streamed = json("lod/lod-meta.json.transforms.json");
  std::uintmax_t bytes = fs::file_size(path("lod/lod-meta.json"));
  for (const auto& entry : fs::recursive_directory_iterator(path("lod")))
    if (entry.is_regular_file() && entry.path().parent_path() != path("lod"))
      bytes += entry.file_size();
  EXPECT_EQ(streamed["bytes"], bytes);
  EXPECT_GT(streamed["fidelity"]["psnr"], 35);
  EXPECT_GT(json("lod/model.rad.transforms.json")["fidelity"]["psnr"], 40);
}

TEST_F(ExportLod, TheFolderAndItsPartsAreModels) {
  ASSERT_EQ(export_lod(text("lod") + " --no-measure").code, 0);
  for (const char* name : {"lod", "lod/lod-meta.json", "lod/0_0", "lod/model.rad"})
    EXPECT_THAT(run("info " + text(name)).out, HasSubstr("4000")) << name;
  EXPECT_THAT(run("info " + text("lod/1_0/meta.json")).out, HasSubstr("1000"));
  EXPECT_EQ(run("export " + text("lod") + " " + text("again.ply")).code, 0);
}

TEST_F(ExportLod, AFolderThatIsThereIsRefusedOrMovedAside) {
  write_bytes(path("lod/notes.txt"), "somebody's");
  const Outcome refused = export_lod(text("lod") + " --no-measure");
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, AllOf(HasSubstr("lod is there already"), HasSubstr("--force")));
  EXPECT_EQ(export_lod(text("lod") + " --no-measure --force").code, 0);
  EXPECT_EQ(read_bytes(path("lod.bak-1/notes.txt")), "somebody's");
  EXPECT_TRUE(fs::exists(path("lod/lod-meta.json")));
  // Not where the model itself would be moved away.
  fs::rename(path("model.ply"), path("lod/model.ply"));
  const Outcome inside =
      run("export " + text("lod/model.ply") + " " + text("lod") + " --lod --no-measure --force");
  EXPECT_EQ(inside.code, 2);
  EXPECT_TRUE(fs::exists(path("lod/model.ply")));
}

TEST_F(ExportLod, WrongCallsAreUsageErrors) {
  EXPECT_THAT(export_lod(text("a") + " " + text("b")).err, HasSubstr("--lod takes one folder"));
  EXPECT_EQ(export_lod(text("a") + " --table").code, 2);
  EXPECT_EQ(run("export " + text("model.ply") + " " + text("a.ply") + " --lod-leaf 500").code, 2);
  EXPECT_THAT(run("export " + text("model.ply") + " " + text("a/lod-meta.json")).err,
              HasSubstr("add --lod"));
}

TEST_F(ExportLod, VerbsReadTheLevelThatAFlagNames) {
  ASSERT_EQ(export_lod(text("lod") + " --no-measure --lod-leaf 600").code, 0);
  EXPECT_THAT(run("info --lod-level 1 " + text("lod")).out, HasSubstr("1000"));
  const Outcome exported =
      run("export --lod-level 2 --no-measure " + text("lod") + " " + text("coarse.ply"));
  ASSERT_EQ(exported.code, 0) << exported.err;
  EXPECT_THAT(run("info " + text("coarse.ply")).out, HasSubstr("256"));
  ASSERT_EQ(run("edit --lod-level 1 " + text("lod") + " --scale 2 -o " + text("edited.ply")).code,
            0);
  EXPECT_THAT(run("info " + text("edited.ply")).out, HasSubstr("1000"));
  EXPECT_THAT(run("info --lod-level 3 " + text("lod")).err,
              HasSubstr("its levels are 0, the finest, to 2"));
  EXPECT_THAT(run("info --lod-level 1 " + text("model.ply")).err,
              AllOf(HasSubstr("has no levels of detail"), HasSubstr("export --lod")));
}

}  // namespace
}  // namespace gs
