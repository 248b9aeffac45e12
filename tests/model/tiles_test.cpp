// SPDX-License-Identifier: Apache-2.0
// Tilesets: the tree of tiles, and their files as a reader of 3D Tiles finds them.
#include <gmock/gmock.h>

#include "gs_core/geometry/vectors.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_model/edit/model_transform.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/spz/spz.h"
#include "gs_model/tiles/tile_tree.h"
#include "gs_model/tiles/tileset.h"
#include "tests/support/captured_log.h"
#include "tests/support/error_of.h"
#include "tests/support/models.h"
#include "tests/support/placed_scene.h"
#include "tests/support/random_model.h"
#include "tests/support/zlib_test.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;
namespace fs = std::filesystem;

/// Small Gaussians in a box of 8 by 6 by 2 units.
GaussianModel scattered(std::size_t count, int sh_degree = 1) {
  GaussianModel model = random_model(count, sh_degree);
  for (std::size_t i = 0; i < count; ++i) {
    model.gaussians.mean[i] *= Vec3f(4, 3, 1);
    model.gaussians.log_scale[i] = model.gaussians.log_scale[i] * 0.3f - 2.5f;
    for (Vec3f& c : model.gaussians.sh_rest[i].coefficient) c *= 0.2f;
  }
  return model;
}

template <class Visit>
void for_each_tile(const Tile& tile, const Visit& visit, int level = 0) {
  visit(tile, level);
  for (const Tile& child : tile.children) for_each_tile(child, visit, level + 1);
}

bool contains(const TileBox& outer, const Vec3d& low, const Vec3d& high) {
  for (int axis = 0; axis < 3; ++axis)
    if (low[axis] < outer.low[axis] || high[axis] > outer.high[axis]) return false;
  return true;
}

TEST(TileTree, LeavesHoldEveryGaussianOnce) {
  const GaussianModel model = scattered(1000);
  std::vector<float> in_tree, in_model;
  const Tile root = tile_tree(model.gaussians, 100);
  for_each_tile(root, [&](const Tile& tile, int) {
    EXPECT_LE(tile.gaussians.count(), 100u);
    if (tile.children.empty())
      for (const float x : tile.gaussians.logit_opacity) in_tree.push_back(x);
  });
  for (const float x : model.gaussians.logit_opacity) in_model.push_back(x);
  std::sort(in_tree.begin(), in_tree.end());
  std::sort(in_model.begin(), in_model.end());
  EXPECT_EQ(in_tree, in_model);
}

TEST(TileTree, EachLevelHasHalfOfTheOneBelow) {
  const GaussianModel model = scattered(1000);
  std::map<int, std::size_t> counts;
  for_each_tile(tile_tree(model.gaussians, 100),
                [&](const Tile& tile, int level) { counts[level] += tile.gaussians.count(); });
  ASSERT_EQ(counts.size(), 5u);
  for (int level = 0; level < 4; ++level)
    EXPECT_NEAR(double(counts[level]), double(counts[level + 1]) / 2, 1 << level);
}

TEST(TileTree, ErrorsGrowUpwardsAndBoxesHoldWhatIsBelow) {
  const GaussianModel model = scattered(1000);
  for_each_tile(tile_tree(model.gaussians, 100), [](const Tile& tile, int) {
    EXPECT_EQ(tile.geometric_error > 0, !tile.children.empty());
    for (const Tile& child : tile.children) {
      EXPECT_GE(tile.geometric_error, child.geometric_error);
      EXPECT_TRUE(contains(tile.box, child.box.low, child.box.high));
    }
    for (std::size_t i = 0; i < tile.gaussians.count(); ++i) {
      const Vec3d mean(tile.gaussians.mean[i]);
      const Vec3f& s = tile.gaussians.log_scale[i];
      const double reach = 3 * std::exp(double(std::min({s.x, s.y, s.z})));  // in every direction
      EXPECT_TRUE(contains(tile.box, mean - Vec3d(reach), mean + Vec3d(reach)));
    }
  });
}

// Nine tenths of the area are that of the large ones, and small ones with less than a tenth do not
// count: 16 / 2 times 2 sigma.
TEST(TileTree, TheErrorIsThatOfSplatsThatCoverMost) {
  GaussianModel model = scattered(10);
  for (std::size_t i = 0; i < 10; ++i) {
    model.gaussians.log_scale[i] = Vec3f(std::log(i < 8 ? 0.001f : 0.01f));
    model.gaussians.logit_opacity[i] = 0;
  }
  EXPECT_NEAR(geometric_error_of(model.gaussians), 8 * 2 * 0.01, 1e-6);
  for (std::size_t i = 0; i < 9; ++i) model.gaussians.log_scale[i] = Vec3f(std::log(0.005f));
  EXPECT_NEAR(geometric_error_of(model.gaussians), 8 * 2 * 0.005, 1e-6);
}

TEST(TileTree, CoarserTilesFollowAboveTheOneThatCoversAll) {
  const GaussianModel model = scattered(5000);
  const Tile root = tile_tree(model.gaussians, 5000);
  std::vector<std::size_t> counts;
  for_each_tile(root, [&](const Tile& tile, int) { counts.push_back(tile.gaussians.count()); });
  EXPECT_EQ(counts, (std::vector<std::size_t>{625, 1250, 2500, 5000}));
}

TEST(TileTree, TheSameGaussiansGiveTheSameTree) {
  const GaussianModel model = scattered(700);
  const Tile a = tile_tree(model.gaussians, 100), b = tile_tree(model.gaussians, 100);
  EXPECT_TRUE(same_bits(a.gaussians, b.gaussians));
  EXPECT_TRUE(same_bits(a.children[1].gaussians, b.children[1].gaussians));
}

class Tileset : public ZlibTest {
 protected:
  fs::path path(const std::string& name) const { return folder_.path() / name; }
  TilesetRequest request(std::size_t most) const {
    return {path("tiles"), true_georeference(), kMaxShDegree, most};
  }
  SortedJson tileset() const { return SortedJson::parse(read_bytes(path("tiles/tileset.json"))); }

 private:
  TempFolder folder_;
};

/// The JSON and the .spz of a tile.
struct ReadTile {
  SortedJson json;
  GaussianModel model;

  explicit ReadTile(const fs::path& file) {
    const std::string bytes = read_bytes(file);
    const auto word = [&](std::size_t at) {
      std::uint32_t value;
      std::memcpy(&value, bytes.data() + at, 4);
      return value;
    };
    EXPECT_EQ(bytes.substr(0, 4), "glTF");
    EXPECT_EQ(word(8), bytes.size());
    EXPECT_EQ(word(12) % 4, 0u);
    const std::size_t begin = 20 + word(12) + 8;
    EXPECT_EQ(begin + word(begin - 8), bytes.size());
    json = SortedJson::parse(bytes.substr(20, word(12)));
    const std::size_t length = json["bufferViews"][0]["byteLength"];
    model = spz_model(file, std::string_view(bytes).substr(begin, length), {1, 1, 1});
  }
};

TEST_F(Tileset, HasWhatCesiumReads) {
  export_tileset(scattered(300), request(100));
  const auto json = tileset();
  EXPECT_EQ(json["asset"]["version"], "1.1");
  EXPECT_EQ(json["extensions"]["3DTILES_content_gltf"]["extensionsRequired"],
            SortedJson({"KHR_gaussian_splatting", "KHR_gaussian_splatting_compression_spz_2"}));
  EXPECT_GT(json["geometricError"], json["root"]["geometricError"]);
  EXPECT_EQ(json["root"]["refine"], "REPLACE");
  ASSERT_EQ(json["root"]["children"].size(), 2u);
  const ReadTile tile(path("tiles") / json["root"]["children"][1]["content"]["uri"]);
  EXPECT_EQ(tile.json["extensionsRequired"].size(), 2u);
  const auto& primitive = tile.json["meshes"][0]["primitives"][0];
  EXPECT_EQ(primitive["attributes"].size(), 4u + 3u);  // three of SH degree 1, and none of degree 0
  EXPECT_FALSE(primitive["attributes"].contains("KHR_gaussian_splatting:SH_DEGREE_0_COEF_0"));
  EXPECT_EQ(tile.json["accessors"][0]["count"], tile.model.gaussians.count());
}

TEST_F(Tileset, GaussiansStandWhereTheSceneIs) {
  GaussianModel model = scattered(90);
  model.world_offset = {500.0, -20.0, 7.0};
  Georeference truth = true_georeference();
  truth.enu_from_input.shift -= truth.enu_from_input(model.world_offset);  // near the origin again
  TilesetRequest asked = request(100);
  asked.georeference = truth;
  export_tileset(model, asked);
  const auto m = tileset()["root"]["transform"].get<std::vector<double>>();
  const ReadTile tile(path("tiles/0/0.glb"));
  ASSERT_EQ(tile.model.gaussians.count(), 90u);
  for (std::size_t i = 0; i < 90; ++i) {
    const Vec3d at(tile.model.gaussians.mean[i]);
    const Vec3d ecef(m[0] * at.x + m[4] * at.y + m[8] * at.z + m[12],
                     m[1] * at.x + m[5] * at.y + m[9] * at.z + m[13],
                     m[2] * at.x + m[6] * at.y + m[10] * at.z + m[14]);
    const Vec3d input = Vec3d(model.gaussians.mean[i]) + model.world_offset;
    // Half a step of 1/4096 m along each axis, and roundings of floats.
    EXPECT_LT(length(ecef - truth.ecef_of_input(input)), 0.001);
  }
}

TEST_F(Tileset, ShapesAndColorsTurnWithTheScene) {
  const GaussianModel model = scattered(50, 3);
  export_tileset(model, request(100));
  GaussianModel found = ReadTile(path("tiles/0/0.glb")).model;
  transform_model(found, inverse_of(transform_of(true_georeference().enu_from_input, Vec3d(0.0))));
  for (std::size_t i = 0; i < 50; ++i) {
    // Steps of .spz: 1/16 in log scale; 1/1023 of a turn; 16/128 in SH beyond degree 1, turned
    EXPECT_LT(length(found.gaussians.log_scale[i] - model.gaussians.log_scale[i]), 0.06f);
    const Quatf &a = found.gaussians.rotation[i], &b = model.gaussians.rotation[i];
    EXPECT_GT(std::abs(a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z), 0.9999f);
    for (int k = 0; k < kShRestCount; ++k)
      EXPECT_LT(length(found.gaussians.sh_rest[i].coefficient[k] -
                       model.gaussians.sh_rest[i].coefficient[k]),
                0.25f);
  }
}

TEST_F(Tileset, BoxesAreInTheTilesFrame) {
  export_tileset(scattered(90), request(100));
  const ReadTile tile(path("tiles/0/0.glb"));
  const auto box = tileset()["root"]["boundingVolume"]["box"].get<std::vector<double>>();
  ASSERT_EQ(box.size(), 12u);
  for (int axis = 0; axis < 3; ++axis) {
    const double half = box[std::size_t(3 + 4 * axis)];
    for (const Vec3f& mean : tile.model.gaussians.mean)
      EXPECT_LE(std::abs(mean[axis] - box[std::size_t(axis)]), half);
    EXPECT_GE(double(tile.json["accessors"][0]["min"][axis]), box[std::size_t(axis)] - half);
  }
}

TEST_F(Tileset, FoldersInUseAreRefusedOrMovedAside) {
  write_bytes(path("tiles/mine.txt"), "mine");
  EXPECT_THAT(error_of([&] { check_tileset(request(100), false); }),
              AllOf(HasSubstr("not empty"), HasSubstr("--force")));
  check_tileset(request(100), true);
  export_tileset(scattered(20), request(100));
  EXPECT_EQ(read_bytes(path("tiles.bak-1/mine.txt")), "mine");
  EXPECT_FALSE(fs::exists(path("tiles/mine.txt")));
  TilesetRequest needs_itself = request(100);
  needs_itself.needed = {path("tiles/tileset.json")};
  EXPECT_NE(error_of([&] { check_tileset(needs_itself, true); }), "");
  write_bytes(path("file"), "mine");
  TilesetRequest on_file = request(100);
  on_file.folder = path("file");
  EXPECT_THAT(error_of([&] { check_tileset(on_file, true); }), HasSubstr("is a file"));
}

TEST_F(Tileset, ModelsThatDoNotFitAreRefused) {
  EXPECT_THAT(error_of([&] { export_tileset(random_moving_model(5, 0), request(100)); }),
              HasSubstr("--time"));
  EXPECT_THAT(error_of([&] { export_tileset(GaussianModel(), request(100)); }),
              HasSubstr("no Gaussians"));
  GaussianModel far = scattered(5);
  far.gaussians.mean[3].x = 3e6f;  // units of 7.5 m
  EXPECT_THAT(error_of([&] { export_tileset(far, request(100)); }),
              AllOf(HasSubstr("from the georeference's origin"), HasSubstr("gemsplat georef")));
  EXPECT_FALSE(fs::exists(path("tiles")));
}

TEST_F(Tileset, FarGaussiansTakeCoarserStepsAndStayWhereTheyAre) {
  GaussianModel model = scattered(5);
  model.gaussians.mean[3] = {1000, 0, 0};  // 7.5 km: two bits fewer
  CapturedLog logged;
  export_tileset(model, request(100));
  EXPECT_THAT(logged.text(), HasSubstr("1 Gaussians stand up to"));
  const ReadTile tile(path("tiles/0/0.glb"));
  const Vec3d expected = true_georeference().enu_from_input(Vec3d(1000.0, 0.0, 0.0));
  EXPECT_LT(length(Vec3d(tile.model.gaussians.mean[3]) - expected), 0.002);
}

}  // namespace
}  // namespace gs
