// SPDX-License-Identifier: Apache-2.0
// A town in blocks: who trains on which photos, and that the merge keeps each Gaussian once.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <set>

#include "gs_app/blocks/merge_blocks.h"
#include "gs_app/blocks/picture_shares.h"
#include "gs_app/blocks/write_partition.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/config/text/region_text.h"
#include "gs_core/math/random.h"
#include "gs_model/formats/ply/ply.h"
#include "tests/support/error_of.h"
#include "tests/support/models.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr int kHouses = 40, kPointsOfHouse = 25;
const Vec3d kFarOffset{500'000.0, 5'400'000.0, 300.0};

/// Houses in a row along x, one unit apart, and a camera in front of each, which shows it and the
/// two houses on either side. Every eighth photo is held out.
SceneOutline street(const Vec3d& world_offset = Vec3d(0.0)) {
  SceneOutline scene;
  scene.world_offset = world_offset;
  const Random random{9, RandomStream::test};
  for (int house = 0; house < kHouses; ++house) {
    for (int p = 0; p < kPointsOfHouse; ++p) {
      const Vec4f u = random.uniform4(std::uint64_t(house), std::uint32_t(p));
      scene.points.push_back({{float(house) + u.x, u.y, 0.5f * u.z}, {}});
    }
    PinholeCamera<float> camera;
    camera.width = camera.height = 100;
    camera.fx = camera.fy = camera.cx = camera.cy = 50;
    camera.cam_from_world_rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    camera.cam_from_world_translation = {-float(house) - 0.5f, -0.5f, 3};
    scene.cameras.push_back(camera);
    scene.names.push_back("photo" + std::to_string(100 + house));
    scene.is_test.push_back(house % 8 == 0);
    scene.shown.emplace_back();
    for (int p = std::max(house - 2, 0) * kPointsOfHouse;
         p < std::min(house + 3, kHouses) * kPointsOfHouse; ++p)
      scene.shown.back().push_back(std::uint32_t(p));
  }
  return scene;
}

bool holds(const std::vector<WideHalfSpace>& region, const Vec3d& p) {
  return std::ranges::all_of(region, [&](const WideHalfSpace& half) { return half.holds(p); });
}

TEST(Partition, EveryPhotoIsInSomeBlockAndNeighborsShareThoseAtTheirBorder) {
  for (const std::size_t blocks : {2, 3, 5}) {
    const SceneOutline scene = street();
    const Partition partition = make_partition(scene, {blocks, 0.1, 0.1});
    ASSERT_EQ(partition.blocks.size(), blocks);
    std::set<std::string> used;
    std::size_t photos = 0;
    for (const Block& block : partition.blocks) {
      used.insert(block.photos.begin(), block.photos.end());
      photos += block.photos.size();
      EXPECT_EQ(block.train_photos + block.test_photos, block.photos.size());
      EXPECT_GT(block.train_photos, 0u);
    }
    EXPECT_EQ(used.size(), scene.names.size());
    EXPECT_GT(photos, scene.names.size());      // some are in two blocks
    EXPECT_LT(photos, scene.names.size() * 2);  // and none in all
  }
}

TEST(Partition, APhotoIsUsedWhereItShowsEnough) {
  // The cut is at x = 20, without a border. Photo 121, which shows houses 19 to 23, has a fifth of
  // its points in block 0.
  const SceneOutline scene = street();
  const auto has = [&](double least_share, std::size_t block, const std::string& name) {
    const Partition partition = make_partition(scene, {2, 0, least_share});
    const std::vector<std::string>& photos = partition.blocks[block].photos;
    return std::ranges::find(photos, name) != photos.end();
  };
  EXPECT_TRUE(has(0.15, 0, "photo121"));
  EXPECT_FALSE(has(0.25, 0, "photo121"));
  EXPECT_TRUE(has(0.25, 1, "photo121"));
  EXPECT_FALSE(has(0.01, 0, "photo122"));
}

TEST(Partition, RegionsReachOverTheirPartsByTheBorder) {
  const Partition partition = make_partition(street(), {2, 0.1, 0.1});
  // Nine tenths of 20 houses reach 18 units, a tenth of which is the border.
  for (const double x : {18.5, 19.5, 20.5, 21.5})
    for (const Block& block : partition.blocks)
      EXPECT_TRUE(holds(block.region, {x, 0.5, 0.2})) << x;
  EXPECT_FALSE(holds(partition.blocks[1].region, {17.5, 0.5, 0.2}));
  EXPECT_FALSE(holds(partition.blocks[0].region, {22.5, 0.5, 0.2}));
  EXPECT_TRUE(holds(partition.blocks[0].region, {-1e9, 50.0, 1e9}));  // the rim has no end
}

TEST(Partition, CountsThePointsThatABlockTrainsOn) {
  const Partition partition = make_partition(street(), {2, 0, 0.25});
  // Photos up to 119 and 120, which show houses 0 to 22
  EXPECT_EQ(partition.blocks[0].points, 23u * kPointsOfHouse);
  EXPECT_EQ(partition.blocks[0].points_outside, 3u * kPointsOfHouse);
}

TEST(Partition, IsTheSameFarFromTheOrigin) {
  const Partition near = make_partition(street(), {4, 0.1, 0.1});
  const Partition far = make_partition(street(kFarOffset), {4, 0.1, 0.1});
  for (std::size_t b = 0; b < 4; ++b) {
    EXPECT_EQ(near.blocks[b].photos, far.blocks[b].photos);
    EXPECT_EQ(near.blocks[b].points_outside, far.blocks[b].points_outside);
  }
  EXPECT_EQ(far.tree.part_of(kFarOffset + Vec3d(39.0, 0.5, 0.2)),
            near.tree.part_of(Vec3d(39.0, 0.5, 0.2)));
}

TEST(Partition, BlocksWithoutPhotosOrPointsAreRefused) {
  EXPECT_THAT(error_of([] {
                make_partition(street(), {900, 0, 0.9});
              }),
              AllOf(HasSubstr("900 blocks"), HasSubstr("--blocks")));
  SceneOutline empty = street();
  empty.points.clear();
  EXPECT_THAT(error_of([&] { make_partition(empty, {}); }), HasSubstr("no sparse points"));
}

TEST(Partition, APhotoIsUsedWhereAModelSaysThatItsPictureLies) {
  // Photo 105 shows no point beyond house 7, but a cloud behind house 30 is half of its picture.
  const SceneOutline scene = street();
  const auto half_in_block_1 = [&](std::size_t view, const std::vector<Block>&) {
    return view == 5 ? std::vector<double>{0.5, 0.5} : std::vector<double>{0, 0};
  };
  const auto of_block_1 = [&](const SharesInView& shares) {
    const Partition partition = make_partition(scene, {2, 0.1, 0.1}, shares);
    const std::vector<std::string>& photos = partition.blocks[1].photos;
    return std::ranges::count(photos, "photo105");
  };
  EXPECT_EQ(of_block_1({}), 0);
  EXPECT_EQ(of_block_1(half_in_block_1), 1);
}

TEST(PictureShares, AreThoseOfTheGaussiansThatMakeUpThePicture) {
  // Camera 10 stands at x = 10.5. A Gaussian on either side of its axis, the right one twice as
  // large.
  for (const Vec3d& offset : {Vec3d(0.0), kFarOffset}) {
    const SceneOutline scene = street(offset);
    OpenedModel opened;
    opened.model = {Gaussians(2, host_memory()), 0, true, false, offset};
    set_gaussian(opened.model.gaussians, 0, {9.5f, 0.5f, 2}, 0.1f, 0.5f);
    set_gaussian(opened.model.gaussians, 1, {11.5f, 0.5f, 2}, 0.1f * std::sqrt(2.0f), 0.5f);
    std::vector<Block> blocks(3);
    blocks[0].region = {{{-1.0, 0.0, 0.0}, -10.5 - offset.x}};
    blocks[1].region = {{{1.0, 0.0, 0.0}, 10.5 + offset.x}};
    blocks[2].region = {{{1.0, 0.0, 0.0}, 9.0 + offset.x}};
    const auto backend = make_scalar_backend();
    PictureShares shares(std::move(opened), {}, scene, *backend);
    const std::vector<double> found = shares(10, blocks);
    EXPECT_NEAR(found[0], 1.0 / 3, 0.03);
    EXPECT_NEAR(found[1], 2.0 / 3, 0.03);
    EXPECT_NEAR(found[2], 1, 1e-6);
    EXPECT_EQ(shares(39, blocks)[2], 0);  // its camera sees neither

    shares.start_from_model(blocks);
    for (std::size_t b = 0; b < 3; ++b) {
      EXPECT_EQ(blocks[b].start, 2u);
      EXPECT_EQ(blocks[b].start_outside, b == 2 ? 0u : 1u);
    }
  }
}

TEST(Partition, ALimitOfGaussiansIsSharedByPoints) {
  const Partition partition = make_partition(street(), {2, 0, 0.25});
  Config config;
  config.density.max_gaussians = 10'000;
  const Config block = settings_of_block(config, partition, partition.blocks[0]);
  EXPECT_EQ(block.density.max_gaussians, 5000 + 3 * kPointsOfHouse);
  Block of_model = partition.blocks[0];
  of_model.start_outside = 2000;
  EXPECT_EQ(settings_of_block(config, partition, of_model).density.max_gaussians, 5000 + 2000);
  EXPECT_EQ(parse_region(block.density.region)->size(), 1u);
  config.density.max_gaussians = kAutoCount;
  EXPECT_EQ(settings_of_block(config, partition, partition.blocks[0]).density.max_gaussians,
            kAutoCount);
}

TEST(Partition, BlocksThatStartFromAModelKeepWhatTheyDoNotSee) {
  Config config;
  const Config of_points = settings_of_all_blocks(config);
  EXPECT_EQ(of_points.density.opacity_regularizer, config.density.opacity_regularizer);
  EXPECT_GT(of_points.density.opacity_regularizer, 0);
  EXPECT_EQ(of_points.density.reset_opacity_until, config.density.reset_opacity_until);
  config.model.start_from = "coarse.ply";
  const Config of_model = settings_of_all_blocks(config);
  EXPECT_EQ(of_model.density.reset_opacity_until, 0);
  EXPECT_EQ(of_model.density.opacity_regularizer, 0);
  for (const char* strategy : {"litegs", "speedy_splat"}) {
    config.density.strategy = strategy;
    EXPECT_THROW(settings_of_all_blocks(config), UsageError) << strategy;
  }
}

/// A partition of the street on the disk, and runs of its blocks, each with the same Gaussians.
class Merge : public ::testing::Test {
 protected:
  BlocksFile write(std::size_t blocks, const Vec3d& world_offset = Vec3d(0.0)) {
    Config config;
    config.dataset.source = temp_.path().string();
    return write_partition(temp_.path() / "parts",
                           make_partition(street(world_offset), {blocks, 0.1, 0.1}), config);
  }
  // Row i has i in its color.
  static Gaussians rows() {
    Gaussians result(1000, host_memory());
    const Random random{4, RandomStream::test};
    for (std::uint32_t i = 0; i < 1000; ++i) {
      const Vec4f u = random.uniform4(i);
      set_gaussian(result, i, {60 * u.x - 10, u.y, u.z}, 0.1f, 0.5f);
      result.sh0[i].x = float(i);
    }
    return result;
  }
  void write_run(const std::filesystem::path& root, const std::string& region,
                 const Vec3d& world_offset = Vec3d(0.0)) {
    const RunFolder run(root);
    Config config;
    config.density.region = region;
    write_text(run.config(), to_toml(config));
    write_text(run.results(), "{}");
    GaussianModel model{rows(), 0, true, false, world_offset};
    write_gaussian_ply(run.ply(30), model);
    if (world_offset != Vec3d(0.0))
      write_text(run.world_offset(), "{\"offset\": [500000, 5400000, 300]}");
  }
  void write_runs(const BlocksFile& blocks, const Vec3d& world_offset = Vec3d(0.0)) {
    for (const BlockEntry& block : blocks.blocks)
      write_run(blocks.folder() / block.run, block.region, world_offset);
  }

  const TempFolder temp_;
};

TEST_F(Merge, TheFileIsReadBackAsItWasWritten) {
  const BlocksFile written = write(5);
  for (const auto& path : {written.folder(), written.file}) {
    const BlocksFile read = read_blocks(path);
    EXPECT_EQ(blocks_json(read), blocks_json(written));
    EXPECT_EQ(read.blocks.size(), 5u);
    EXPECT_EQ(read.tree.part_of({39.5, 0.5, 0.2}), written.tree.part_of({39.5, 0.5, 0.2}));
  }
}

TEST_F(Merge, KeepsEachGaussianExactlyOnce) {
  const BlocksFile blocks = write(5);
  write_runs(blocks);
  const MergedBlocks merged = merge_blocks(blocks, {});
  const Gaussians& result = merged.model.model.gaussians;
  ASSERT_EQ(result.count(), 1000u);
  std::set<int> kept;
  for (const Vec3f& color : result.sh0) kept.insert(int(color.x));
  EXPECT_EQ(kept.size(), 1000u);
  std::size_t owned = 0;
  for (const BlockShare& share : merged.shares) {
    EXPECT_EQ(share.gaussians, 1000u);
    EXPECT_GT(share.owned, 0u);
    owned += share.owned;
  }
  EXPECT_EQ(owned, 1000u);
}

TEST_F(Merge, TakesEachGaussianFromTheBlockThatOwnsItsPlace) {
  const BlocksFile blocks = write(3);
  GaussianModel model{rows(), 0, true, false, Vec3d(0.0)};
  std::size_t all = 0;
  for (std::size_t b = 0; b < 3; ++b)
    for (const std::uint32_t row : rows_in_part(model, blocks.tree, b)) {
      EXPECT_EQ(blocks.tree.part_of(Vec3d(model.gaussians.mean[row])), b);
      ++all;
    }
  EXPECT_EQ(all, 1000u);
}

TEST_F(Merge, OwnsPlacesOfScenesFarFromTheOrigin) {
  const BlocksFile near = write(2);
  const CutTree far_tree = make_partition(street(kFarOffset), {2, 0.1, 0.1}).tree;
  const GaussianModel model{rows(), 0, true, false, Vec3d(0.0)};
  const GaussianModel moved{rows(), 0, true, false, kFarOffset};
  EXPECT_EQ(rows_in_part(model, near.tree, 1), rows_in_part(moved, far_tree, 1));
}

TEST_F(Merge, RunsOfAnotherPlaceAreKnownByTheirRegion) {
  const BlocksFile blocks = write(2);
  write_run(temp_.path() / "b", blocks.blocks[1].region);
  write_run(temp_.path() / "a", blocks.blocks[0].region);
  const MergedBlocks merged = merge_blocks(blocks, {{temp_.path() / "b", temp_.path() / "a"}, {}});
  EXPECT_EQ(merged.model.model.gaussians.count(), 1000u);
  EXPECT_EQ(merged.shares[0].run, temp_.path() / "a");
  EXPECT_EQ(merged.shares[1].run, temp_.path() / "b");
}

TEST_F(Merge, RunsThatDoNotBelongAreRefusedWithARemedy) {
  const BlocksFile blocks = write(2);
  const auto refusal = [&](const BlockRuns& runs) {
    return error_of([&] { merge_blocks(blocks, runs); });
  };
  EXPECT_THAT(refusal({}), AllOf(HasSubstr("block0 has no run"), HasSubstr("gemsplat experiment")));
  write_runs(blocks);
  write_run(temp_.path() / "other", "1,0,0,5");
  EXPECT_THAT(refusal({{temp_.path() / "other"}, {}}), HasSubstr("of no block"));
  EXPECT_THAT(refusal({{temp_.path() / "nothing"}, {}}), HasSubstr("no run in"));
  write_run(temp_.path() / "again", blocks.blocks[1].region);
  EXPECT_THAT(refusal({{blocks.folder() / blocks.blocks[1].run, temp_.path() / "again"}, {}}),
              HasSubstr("both runs of block1"));
  write_run(blocks.folder() / blocks.blocks[1].run, "1,0,0,5");
  EXPECT_THAT(refusal({}), HasSubstr("another partition"));
}

TEST_F(Merge, AnUnfinishedRunIsMergedOnlyWhereItsStepIsNamed) {
  const BlocksFile blocks = write(2);
  write_runs(blocks);
  std::filesystem::remove(RunFolder(blocks.folder() / blocks.blocks[1].run).results());
  EXPECT_THAT(error_of([&] { merge_blocks(blocks, {}); }),
              AllOf(HasSubstr("block1 is not finished"), HasSubstr("--iteration")));
  EXPECT_EQ(merge_blocks(blocks, {{}, 30}).model.model.gaussians.count(), 1000u);
}

TEST_F(Merge, FilesThatAreNoPartitionAreRefused) {
  const BlocksFile blocks = write(3);
  EXPECT_THAT(error_of([&] { read_blocks(temp_.path() / "nowhere"); }),
              HasSubstr("gemsplat partition"));
  const std::string text = blocks_json(blocks);
  const auto refusal = [&](const std::string& other) {
    write_bytes(blocks.file, other);
    return error_of([&] { read_blocks(blocks.file); });
  };
  EXPECT_THAT(refusal(text.substr(0, text.size() / 2)), HasSubstr("blocks.json"));
  EXPECT_THAT(refusal("{}"), HasSubstr("blocks.json"));
  std::string circle = text;
  circle.replace(circle.find("\"block\": 2"), 10, "\"block\": 1");
  EXPECT_THAT(refusal(circle), HasSubstr("do not divide space"));
}

TEST_F(Merge, AFileThatNamesABlockTwiceOrInAnothersPlaceIsRefused) {
  const BlocksFile blocks = write(3);
  const auto refusal = [&](const std::function<void(BlocksFile&)>& change) {
    BlocksFile other = blocks;
    change(other);
    write_bytes(blocks.file, blocks_json(other));
    return error_of([&] { read_blocks(blocks.file); });
  };
  EXPECT_THAT(refusal([](BlocksFile& b) { b.blocks[2] = b.blocks[0]; }),
              AllOf(HasSubstr("names block0 twice"), HasSubstr("gemsplat partition")));
  EXPECT_THAT(refusal([](BlocksFile& b) { b.blocks[2].run = "./" + b.blocks[0].run; }),
              HasSubstr("the run of another"));
  EXPECT_THAT(refusal([](BlocksFile& b) { b.blocks[2].region = b.blocks[0].region; }),
              HasSubstr("does not hold what the block owns"));
  EXPECT_THAT(refusal([](BlocksFile& b) { std::swap(b.blocks[0], b.blocks[1]); }),
              HasSubstr("does not hold"));
  write_bytes(blocks.file, blocks_json(blocks));
  EXPECT_EQ(read_blocks(blocks.file).blocks.size(), 3u);
}

}  // namespace
}  // namespace gs
