// SPDX-License-Identifier: Apache-2.0
// .glb as other programs write it: nodes that move, several primitives, integers, an .spz inside.
#include "gs_model/formats/glb/glb.h"

#include <gmock/gmock.h>

#include <cmath>

#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/math/render/sh.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/coding/frame.h"
#include "gs_model/formats/formats.h"
#include "gs_model/formats/model_transform.h"
#include "gs_model/formats/spz/spz.h"
#include "tests/support/error_of.h"
#include "tests/support/glb_parts.h"
#include "tests/support/models.h"
#include "tests/support/random_model.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class Glb : public testing::Test {
 protected:
  static void SetUpTestSuite() { setup_log(Verbosity::quiet); }
  std::filesystem::path file(const std::string& name) const { return folder_.path() / name; }
  GlbParts parts_of(const GaussianModel& model) const {
    write_model(file("parts.glb"), model);
    return glb_parts(read_bytes(file("parts.glb")));
  }
  GaussianModel read(const GlbParts& parts) const {
    write_bytes(file("a.glb"), glb_file_of(parts));
    return read_model(file("a.glb"));
  }
  /// The file of a model whose mesh is that of so many nodes.
  GlbParts shown_often(const GaussianModel& model, int times) const {
    GlbParts parts = parts_of(model);
    Json nodes = Json::array(), indices = Json::array();
    for (int n = 0; n < times; ++n) {
      nodes.push_back({{"mesh", 0}});
      indices.push_back(n);
    }
    parts.json["nodes"] = nodes;
    parts.json["scenes"][0]["nodes"] = indices;
    return parts;
  }
  std::string error_with(const GlbParts& parts) const {
    return error_of([&] { read(parts); });
  }

  TempFolder folder_;
};

Vec3f gltf_axes(const Vec3f& v) { return v * kHalfTurnZ; }

/// The color of Gaussian i seen along `direction`, without the offset of 0.5.
Vec3f color(const GaussianModel& model, std::size_t i, const Vec3f& direction) {
  float basis[kShBasisCount];
  sh_basis(kMaxShDegree, direction, basis);
  Vec3f sum = basis[0] * model.gaussians.sh0[i];
  for (int k = 0; k < kShRestCount; ++k)
    sum += basis[k + 1] * model.gaussians.sh_rest[i].coefficient[k];
  return sum;
}

/// x of glTF becomes -z, and z becomes x: a quarter turn about y.
Vec3f quarter_turn(const Vec3f& v) { return {v.z, v.y, -v.x}; }
const Json kQuarterTurn = {0, std::sqrt(0.5), 0, std::sqrt(0.5)};  // x y z w

TEST_F(Glb, NodesTurnScaleAndMoveTheirGaussians) {
  const GaussianModel model = random_model(20, 3);
  GlbParts parts = parts_of(model);
  parts.json["nodes"][0]["rotation"] = kQuarterTurn;
  parts.json["nodes"][0]["scale"] = {2, 2, 2};
  parts.json["nodes"][0]["translation"] = {1, -2, 3};
  const GaussianModel moved = read(parts);
  const auto turned = [](const Vec3f& v) { return gltf_axes(quarter_turn(gltf_axes(v))); };
  for (std::size_t i = 0; i < 20; ++i) {
    const Vec3f mean =
        gltf_axes(2.0f * quarter_turn(gltf_axes(model.gaussians.mean[i])) + Vec3f(1, -2, 3));
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(moved.gaussians.mean[i][axis], mean[axis], 1e-5f);
      EXPECT_NEAR(moved.gaussians.log_scale[i][axis],
                  model.gaussians.log_scale[i][axis] + std::log(2.0f), 1e-5f);
      Vec3f unit(0.0f);
      unit[axis] = 1;
      const Vec3f before = turned(multiply(rotation_matrix(model.gaussians.rotation[i]), unit));
      const Vec3f after = multiply(rotation_matrix(moved.gaussians.rotation[i]), unit);
      EXPECT_NEAR(inner(before, after), 1, 1e-5f);  // the axes of the ellipsoid turn with it
    }
    const Vec3f direction(0.48f, -0.6f, 0.64f);
    const Vec3f seen = color(moved, i, turned(direction)), was = color(model, i, direction);
    for (int channel = 0; channel < 3; ++channel) EXPECT_NEAR(seen[channel], was[channel], 2e-5f);
  }
}

TEST_F(Glb, AMatrixIsReadColumnByColumnAndParentsComeFirst) {
  const GaussianModel model = random_model(5, 1);
  GlbParts parts = parts_of(model);
  parts.json["nodes"] = {{{"mesh", 0}, {"translation", {0, 0, 7}}},
                         {{"children", {0}},
                          {"matrix",
                           {0, 0, -1, 0, 0, 1, 0, 0,  //
                            1, 0, 0, 0, 5, 6, 7, 1}}}};
  parts.json["scenes"][0]["nodes"] = {1};
  const GaussianModel moved = read(parts);
  for (std::size_t i = 0; i < 5; ++i) {
    const Vec3f in_child = gltf_axes(model.gaussians.mean[i]) + Vec3f(0, 0, 7);
    const Vec3f mean = gltf_axes(quarter_turn(in_child) + Vec3f(5, 6, 7));
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(moved.gaussians.mean[i][axis], mean[axis], 1e-5f);
  }
}

TEST_F(Glb, PrimitivesAndNodesAreBroughtTogether) {
  const GaussianModel model = random_model(4, 1);
  GlbParts parts = parts_of(model);
  Json& primitives = parts.json["meshes"][0]["primitives"];
  primitives.push_back(primitives[0]);
  primitives[1]["attributes"].erase("KHR_gaussian_splatting:SH_DEGREE_1_COEF_0");
  parts.json["nodes"].push_back({{"mesh", 0}, {"translation", {1, 0, 0}}});
  parts.json["scenes"][0]["nodes"] = {0, 1};
  const GaussianModel both = read(parts);
  ASSERT_EQ(both.gaussians.count(), 16u);
  EXPECT_EQ(both.sh_degree, 1);
  EXPECT_NE(both.gaussians.sh_rest[0].coefficient[0], Vec3f(0));
  EXPECT_EQ(both.gaussians.sh_rest[4].coefficient[0], Vec3f(0));  // of the one without SH
  EXPECT_EQ(both.gaussians.mean[4], model.gaussians.mean[0]);
  EXPECT_NEAR(both.gaussians.mean[12].x, model.gaussians.mean[0].x - 1, 1e-6f);
  parts.json["scenes"] = Json::array({{{"nodes", {0}}}, {{"nodes", {1}}}});
  parts.json["scene"] = 1;
  EXPECT_EQ(read(parts).gaussians.count(), 8u);  // what other scenes show is left out
  parts.json.erase("scenes");
  EXPECT_EQ(read(parts).gaussians.count(), 8u);  // every primitive once
}

TEST_F(Glb, NodesThatNoModelCanFollowAreRefusedWithARemedy) {
  const GlbParts good = parts_of(random_model(3, 1));
  const auto error_at = [&](const char* pointer, const Json& value) {
    GlbParts parts = good;
    parts.json[Json::json_pointer(pointer)] = value;
    return error_with(parts);
  };
  for (const Json& scale : {Json{1, 2, 1}, Json{-1, 1, 1}, Json{0, 0, 0}, Json{1e9, 1e9, 1e9}})
    EXPECT_THAT(error_at("/nodes/0/scale", scale),
                AllOf(HasSubstr("mirrors, stretches or shears"), HasSubstr("apply the node")))
        << scale;
  EXPECT_THAT(error_at("/nodes/0/matrix", {1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}),
              HasSubstr("mirrors, stretches or shears"));
  EXPECT_THAT(error_at("/nodes/0/scale", 2), HasSubstr("not 3 numbers"));
  EXPECT_THAT(error_at("/nodes/0/rotation", {0, 0, 0, 0}), HasSubstr("not of length 1"));
  EXPECT_THAT(error_at("/nodes/0/children", {0}), HasSubstr("no tree"));
  EXPECT_THAT(error_at("/nodes/0/children", {1}), HasSubstr("lacks an entry of \"nodes\""));
  EXPECT_THAT(error_at("/scenes/0/nodes", {{"a", 1}}), HasSubstr("list of nodes"));
  EXPECT_THAT(error_at("/scenes/0/nodes", Json::array()), HasSubstr("holds no Gaussians"));
  GlbParts chain = good;
  for (int n = 0; n < 100; ++n) chain.json["nodes"][std::size_t(n)]["children"] = {n + 1};
  chain.json["nodes"].push_back(Json::object());
  EXPECT_THAT(error_with(chain), HasSubstr("nests more than 64 nodes"));
}

TEST_F(Glb, ManyNodesOfOneMeshCannotFillTheMemory) {
  EXPECT_THAT(error_with(shown_often(random_model(1000, 0), 300)), HasSubstr("it promises"));
}

TEST_F(Glb, MoreNodesThanAnySceneHasAreRefusedBeforeOneIsDecoded) {
  const GaussianModel model = random_model(3, 0);
  EXPECT_EQ(read(shown_often(model, 4096)).gaussians.count(), 3u * 4096);
  EXPECT_THAT(error_with(shown_often(model, 4097)),
              AllOf(HasSubstr("more than 4096 places"), HasSubstr("export it again")));
  EXPECT_THAT(error_with(shown_often(model, 200'000)), HasSubstr("more than 4096 places"));
}

TEST_F(Glb, LinearColorsAndMeshesOfTrianglesAreRefusedWithARemedy) {
  GlbParts parts = parts_of(random_model(3, 1));
  Json& extensions = parts.json["meshes"][0]["primitives"][0]["extensions"];
  extensions["KHR_gaussian_splatting"]["colorSpace"] = "lin_rec709_display";
  EXPECT_THAT(error_with(parts), AllOf(HasSubstr("lin_rec709_display"), HasSubstr("export it")));
  extensions = Json::object();
  EXPECT_THAT(error_with(parts), HasSubstr("its scene holds no Gaussians"));
}

TEST_F(Glb, IntegersAreFractionsWhereTheyAreNormalized) {
  GlbParts parts = parts_of(random_model(2, 0));
  const std::size_t at = parts.binary.size();
  parts.binary += std::string("\x33\xFF\x40\0", 4);  // 0.2 and 1
  Json& json = parts.json;
  json["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", at}, {"byteLength", 2}});
  const std::size_t opacity =
      json["meshes"][0]["primitives"][0]["attributes"]["KHR_gaussian_splatting:OPACITY"];
  json["accessors"][opacity] = {{"bufferView", json["bufferViews"].size() - 1},
                                {"componentType", 5121},
                                {"normalized", true},
                                {"count", 2},
                                {"type", "SCALAR"}};
  const GaussianModel model = read(parts);
  EXPECT_NEAR(sigmoid(model.gaussians.logit_opacity[0]), 0.2f, 1e-6f);
  EXPECT_NEAR(sigmoid(model.gaussians.logit_opacity[1]), 1.0f, 1e-6f);
  json["accessors"][opacity]["componentType"] = 5125;
  EXPECT_THAT(error_with(parts), HasSubstr("a type that Gaussians do not have"));
}

TEST_F(Glb, AnSpzInsideIsReadUnderEachOfItsNames) {
  try {
    require_zlib();
  } catch (const Error& missing) {
    GTEST_SKIP() << missing.what();
  }
  const GaussianModel model = random_model(30, 3);
  write_model(file("a.spz"), model);
  const GaussianModel expected = read_model(file("a.spz"));
  const GaussianModel draft = read(
      glb_with_spz(read_bytes(file("a.spz")), "KHR_gaussian_splatting_compression_spz_2", true));
  EXPECT_TRUE(same_bits(draft.gaussians, expected.gaussians));
  // Without the draft's members the numbers of the .spz are glTF's.
  const std::string raw = spz_bytes(model, {}, kHalfTurnZ);
  for (const char* name :
       {"KHR_gaussian_splatting_compression_spz_2", "KHR_gaussian_splatting_compression_spz",
        "KHR_spz_gaussian_splats_compression"}) {
    SCOPED_TRACE(name);
    const GaussianModel back = read(glb_with_spz(raw, name, false));
    ASSERT_EQ(back.gaussians.count(), 30u);
    for (std::size_t i = 0; i < 30; ++i) {
      const Quatf &p = back.gaussians.rotation[i], &q = expected.gaussians.rotation[i];
      EXPECT_EQ(back.gaussians.mean[i], expected.gaussians.mean[i]);
      EXPECT_NEAR(std::abs(p.w * q.w + p.x * q.x + p.y * q.y + p.z * q.z), 1, 1e-5f);
      for (int k = 0; k < kShRestCount; ++k)  // halves of a step of 1/8 are rounded upwards
        for (int c = 0; c < 3; ++c)
          EXPECT_NEAR(back.gaussians.sh_rest[i].coefficient[k][c],
                      expected.gaussians.sh_rest[i].coefficient[k][c], 0.126f);
    }
  }
}

TEST_F(Glb, TheWorldOffsetOfAnUnmovedNodeIsTaken) {
  GaussianModel model = random_model(3, 0);
  model.world_offset = {500'000, 5'400'000, 300.5};
  GlbParts parts = parts_of(model);
  EXPECT_EQ(read(parts).world_offset, model.world_offset);
  parts.json["nodes"][0]["translation"] = {1, 0, 0};
  EXPECT_EQ(read(parts).world_offset, Vec3d(0.0));
}

}  // namespace
}  // namespace gs
