// SPDX-License-Identifier: Apache-2.0
// Streamed SOG: levels come back from a folder, with the rows of each leaf where the tree says, and
// damaged folders are refused or read.
#include "gs_model/formats/lod/streamed_sog.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_core/threads/parallel.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/formats.h"
#include "gs_model/formats/sog/sog.h"
#include "gs_model/formats/sog/webp.h"
#include "tests/support/damage.h"
#include "tests/support/error_of.h"
#include "tests/support/random_model.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

constexpr float kMean = 4e-4f;  // a step of 1/65535 of the range of logarithms

class StreamedSog : public testing::Test {
 protected:
  static void SetUpTestSuite() { setup_log(Verbosity::quiet); }
  void SetUp() override {
    try {
      require_webp();
    } catch (const Error& missing) {
      GTEST_SKIP() << missing.what();
    }
  }
  static LodTree tree_of(std::size_t count) {
    const GaussianModel model = finite_model(random_model(count, 1));
    LodOptions options;
    options.leaf_rows = 100;
    options.coarsest_rows = 20;
    return build_lod_tree(copy_of(model.gaussians), options);
  }
  /// Leaves of 94 rows: two share a file at level 0, and more at others.
  std::vector<StreamedLevel> write(const LodTree& tree) const {
    return write_streamed_sog(folder(), tree, {1, false, 200});
  }
  fs::path folder() const { return temp_.path() / "scene"; }
  fs::path meta() const { return folder() / kLodMeta; }
  Json json() const { return Json::parse(read_bytes(meta())); }
  std::string error_with(const Json& changed) const {
    replace_bytes(meta(), changed.dump());
    return error_of([&] { read_model(meta()); });
  }

  TempFolder temp_;
};

// The leaves of a node, in order.
void leaves_of(const Json& node, std::vector<Json>& leaves) {
  if (node.contains("lods")) return leaves.push_back(node);
  for (const Json& child : node["children"]) leaves_of(child, leaves);
}

TEST_F(StreamedSog, EveryLevelComesBack) {
  const LodTree tree = tree_of(1500);
  const std::vector<StreamedLevel> written = write(tree);
  ASSERT_EQ(written.size(), 4u);
  for (int k = 0; k < 4; ++k) {
    const GaussianModel back = read_streamed_sog(meta(), k);
    const Gaussians& level = tree.levels[std::size_t(k)].gaussians;
    ASSERT_EQ(back.gaussians.count(), level.count());
    EXPECT_EQ(written[std::size_t(k)].gaussians, level.count());
    EXPECT_EQ(back.sh_degree, 1);
    for (std::size_t i = 0; i < level.count(); ++i)  // files and their rows are in the same order
      for (int axis = 0; axis < 3; ++axis)
        ASSERT_NEAR(back.gaussians.mean[i][axis], level.mean[i][axis], kMean) << k << " " << i;
  }
}

TEST_F(StreamedSog, TheTreeNamesTheRowsOfEachLeafAndABoxAroundThem) {
  const LodTree tree = tree_of(1500);
  write(tree);
  const Json json = this->json();
  EXPECT_EQ(json["lodLevels"], 4);
  EXPECT_EQ(json["counts"][0], 1500);
  std::vector<Json> leaves;
  leaves_of(json["tree"], leaves);
  ASSERT_EQ(leaves.size(), tree.num_leaves());
  for (std::size_t leaf = 0; leaf < leaves.size(); ++leaf)
    for (std::size_t k = 0; k < 4; ++k) {
      const Json& lod = leaves[leaf]["lods"][std::to_string(k)];
      const fs::path file = folder() / json["filenames"][lod["file"].get<std::size_t>()];
      const GaussianModel rows = read_sog_folder(file);
      const LodLevel& level = tree.levels[k];
      ASSERT_EQ(lod["count"], level.count(leaf));
      for (std::size_t i = 0; i < level.count(leaf); ++i)
        for (int axis = 0; axis < 3; ++axis) {
          const float mean = rows.gaussians.mean[lod["offset"].get<std::size_t>() + i][axis];
          EXPECT_NEAR(mean, level.gaussians.mean[level.leaf_begin[leaf] + i][axis], kMean);
          EXPECT_GT(mean, leaves[leaf]["bound"]["min"][std::size_t(axis)]);
          EXPECT_LT(mean, leaves[leaf]["bound"]["max"][std::size_t(axis)]);
        }
    }
}

TEST_F(StreamedSog, FilesHoldWholeLeavesUpToTheirLimit) {
  write(tree_of(1500));
  const Json json = this->json();
  std::vector<std::size_t> rows;
  for (const Json& name : json["filenames"])
    rows.push_back(read_sog_folder(folder() / name).gaussians.count());
  EXPECT_THAT(rows, testing::Each(testing::Le(200u)));
  EXPECT_GT(rows.size(), 8u);
  EXPECT_LT(rows.size(), 14u);
}

TEST_F(StreamedSog, TheSameTreeGivesTheSameBytes) {
  const LodTree tree = tree_of(400);
  write(tree);
  write_streamed_sog(temp_.path() / "again", tree, {1, false, 200});
  for (const auto& entry : fs::recursive_directory_iterator(folder())) {
    if (!entry.is_regular_file()) continue;
    EXPECT_EQ(read_bytes(entry.path()),
              read_bytes(temp_.path() / "again" / fs::relative(entry.path(), folder())))
        << entry.path();
  }
}

TEST_F(StreamedSog, FoldersAreModels) {
  const LodTree tree = tree_of(400);
  write(tree);
  EXPECT_EQ(read_model(folder()).gaussians.count(), 400u);
  EXPECT_EQ(read_model(folder() / "1_0" / "meta.json").gaussians.count(),
            read_model(folder() / "1_0").gaussians.count());
  EXPECT_EQ(find_format(meta())->name, "streamed sog");
  EXPECT_THAT(error_of([&] { format_to_write(meta()); }), HasSubstr("add --lod"));
}

TEST_F(StreamedSog, ALeafWithoutALevelShowsTheNextOneThatItHas) {
  write(tree_of(400));
  Json json = this->json();
  Json* leaf = &json["tree"];
  while (leaf->contains("children")) leaf = &(*leaf)["children"][0];
  const std::size_t fine = (*leaf)["lods"]["0"]["count"], coarse = (*leaf)["lods"]["1"]["count"];
  (*leaf)["lods"].erase("0");
  replace_bytes(meta(), json.dump());
  EXPECT_EQ(read_model(meta()).gaussians.count(), 400 - fine + coarse);
}

TEST_F(StreamedSog, WrongFoldersAreRefusedWithARemedy) {
  write(tree_of(400));
  const Json good = json();
  const auto error_at = [&](const char* pointer, const Json& value) {
    Json changed = good;
    changed[Json::json_pointer(pointer)] = value;
    return error_with(changed);
  };
  EXPECT_THAT(error_at("/version", 2), HasSubstr("export it as version 1"));
  EXPECT_THAT(error_at("/filenames/0", "../meta.json"),
              AllOf(HasSubstr("not in its folder"), HasSubstr("put all its files")));
  EXPECT_THAT(error_at("/filenames/0", "/etc/passwd"), HasSubstr("not in its folder"));
  EXPECT_THAT(error_at("/filenames/0", 3), HasSubstr("no text"));
  EXPECT_THAT(error_at("/filenames/0", "none/meta.json"), HasSubstr("none/meta.json"));
  EXPECT_THAT(error_at("/tree", Json::object()), HasSubstr("neither children nor levels"));
  EXPECT_THAT(error_at("/tree", Json{{"lods", {{"0", {{"file", 0}, {"count", 4'000'000'000u}}}}}}),
              HasSubstr("rows that its files do not have"));
  EXPECT_THAT(error_at("/tree", Json{{"lods", {{"0", {{"file", 99}, {"count", 1}}}}}}),
              HasSubstr("a file that it does not name"));
  // Two names of one file with all its rows each.
  Json twice = good;
  twice["filenames"] = {"0_0/meta.json", "0_0/../0_0/meta.json"};
  const Json all = {{"file", 0}, {"count", 188}}, again = {{"file", 1}, {"count", 188}};
  twice["tree"] = {{"children", {{{"lods", {{"0", all}}}}, {{"lods", {{"0", again}}}}}}};
  EXPECT_THAT(error_with(twice), HasSubstr("rows that its files do not have"));
}

TEST_F(StreamedSog, PicturesOfOtherFoldersAreNotRead) {
  write(tree_of(400));
  Json sog = Json::parse(read_bytes(folder() / "0_0/meta.json"));
  sog["quats"]["files"][0] = "../1_0/quats.webp";
  replace_bytes(folder() / "0_0/meta.json", sog.dump());
  EXPECT_THAT(error_of([&] { read_model(meta()); }), HasSubstr("lacks ../1_0/quats.webp"));
}

TEST_F(StreamedSog, DamagedFoldersAreReadOrRefused) {
  const SerialLoops no_threads;
  const LodTree tree = tree_of(30);
  write_streamed_sog(folder(), tree, {1, false, 200});
  const std::vector<fs::path> files = {meta(), folder() / "0_0/meta.json",
                                       folder() / "0_0/means_l.webp"};
  std::vector<std::string> bytes;
  for (const fs::path& file : files) bytes.push_back(read_bytes(file));
  const FuzzCases cases;
  for (unsigned number = cases.first; number < cases.first + cases.count; ++number) {
    std::mt19937 random(number);
    const std::size_t k = random() % 8 < 5 ? 0 : 1 + random() % 2;  // mostly the new one
    replace_bytes(files[k], damaged(bytes[k], random));
    EXPECT_EQ(trouble_of([&] { read_model(meta()); }), "") << "case " << number;
    replace_bytes(files[k], bytes[k]);
  }
}

}  // namespace
}  // namespace gs
