// SPDX-License-Identifier: Apache-2.0
// .glb of other programs: what is read, and what is refused with a remedy. formats_test.cpp and
// golden_formats_test.cpp have our own files.
#include "gs_model/formats/glb/glb.h"

#include <gmock/gmock.h>

#include <cmath>

#include "gs_core/math/render/activations.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_model/formats/formats.h"
#include "tests/support/error_of.h"
#include "tests/support/glb_parts.h"
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
  std::string error_with(const GlbParts& parts) const {
    return error_of([&] { read(parts); });
  }

  TempFolder folder_;
};

TEST_F(Glb, NodesThatMoveAreRefusedWithARemedy) {
  const GaussianModel model = random_model(5, 1);
  const GlbParts good = parts_of(model);
  const auto with = [&](const char* key, const Json& value) {
    GlbParts parts = good;
    parts.json["nodes"][0][key] = value;
    return parts;
  };
  const Json turned = {0, 0, -1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1};
  for (const GlbParts& parts :
       {with("translation", {0, 0, 7}), with("scale", {2, 2, 2}), with("rotation", {0, 1, 0, 0}),
        with("matrix", turned), with("matrix", "none")})
    EXPECT_THAT(error_with(parts),
                AllOf(HasSubstr("a node turns, scales or moves"), HasSubstr("apply the node")));
  for (const GlbParts& parts : {with("translation", {0.0, 0, 0}), with("scale", {1, 1.0, 1}),
                                with("rotation", {0, 0, 0, 1}), with("name", "garden")})
    EXPECT_EQ(read(parts).gaussians.mean[4], model.gaussians.mean[4]);
}

TEST_F(Glb, SeveralSetsOfGaussiansAreRefusedWithARemedy) {
  GlbParts parts = parts_of(random_model(4, 1));
  Json& primitives = parts.json["meshes"][0]["primitives"];
  primitives.push_back({{"mode", 4}, {"attributes", {{"POSITION", 0}}}});  // triangles beside them
  EXPECT_EQ(read(parts).gaussians.count(), 4u);
  primitives.push_back(primitives[0]);
  EXPECT_THAT(error_with(parts), AllOf(HasSubstr("several sets"), HasSubstr("join them")));
}

TEST_F(Glb, LinearColorsAndMeshesOfTrianglesAreRefusedWithARemedy) {
  GlbParts parts = parts_of(random_model(3, 1));
  Json& extensions = parts.json["meshes"][0]["primitives"][0]["extensions"];
  extensions["KHR_gaussian_splatting"]["colorSpace"] = "lin_rec709_display";
  EXPECT_THAT(error_with(parts), AllOf(HasSubstr("lin_rec709_display"), HasSubstr("export it")));
  extensions = Json::object();
  EXPECT_THAT(error_with(parts), HasSubstr("its scene holds no Gaussians"));
}

TEST_F(Glb, CompressedGaussiansAreRefusedWithARemedy) {
  GlbParts parts = parts_of(random_model(3, 1));
  parts.json["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["extensions"] = {
      {"KHR_gaussian_splatting_compression_spz_2", {{"bufferView", 0}}}};
  EXPECT_THAT(error_with(parts),
              AllOf(HasSubstr("compressed"), HasSubstr("name the model that it was made of")));
}

TEST_F(Glb, AttributesThatAreNoFloatsOfItsSizeAreRefused) {
  const GlbParts good = parts_of(random_model(20, 1));
  const auto error_at = [&](const char* pointer, const Json& value) {
    GlbParts parts = good;
    parts.json[Json::json_pointer(pointer)] = value;
    return error_with(parts);
  };
  EXPECT_THAT(error_at("/accessors/0/componentType", 5125), HasSubstr("not floats, bytes"));
  EXPECT_THAT(error_at("/accessors/0/type", "VEC4"), HasSubstr("not a VEC3"));
  EXPECT_THAT(error_at("/accessors/0/sparse", Json::object()), HasSubstr("sparse"));
  EXPECT_THAT(error_at("/accessors/0/count", 21), HasSubstr("beyond the end of its view"));
  EXPECT_THAT(error_at("/accessors/0/count", 19), HasSubstr("of different lengths"));
  EXPECT_THAT(error_at("/accessors/0/byteOffset", 4), HasSubstr("beyond the end of its view"));
  EXPECT_THAT(error_at("/accessors/0/bufferView", 99), HasSubstr("entry of \"bufferViews\""));
  EXPECT_THAT(error_at("/accessors/0/count", -1), HasSubstr("no valid number \"count\""));
  EXPECT_THAT(error_at("/bufferViews/0/byteStride", 8), HasSubstr("lie over each other"));
  EXPECT_THAT(error_at("/bufferViews/0/byteStride", 16), HasSubstr("beyond the end of its view"));
  EXPECT_THAT(error_at("/bufferViews/0/byteLength", 1 << 20), HasSubstr("a view beyond its end"));
  EXPECT_THAT(error_at("/buffers/0/uri", "other.bin"), HasSubstr("in another file"));
}

// KHR_gaussian_splatting, as it was ratified in June 2026, permits these types.
TEST_F(Glb, WholeNumbersAndGapsAreReadAsTheExtensionPermitsThem) {
  GlbParts parts = parts_of(random_model(2, 0));
  parts.binary.resize((parts.binary.size() + 3) / 4 * 4);
  const auto put = [&](const char* name, int type, bool is_normalized, int stride,
                       const std::string& bytes) {
    Json& json = parts.json;
    json["accessors"].push_back({{"bufferView", json["bufferViews"].size()},
                                 {"componentType", type},
                                 {"normalized", is_normalized},
                                 {"count", 2},
                                 {"type", *name == 'O'   ? "SCALAR"
                                          : *name == 'S' ? "VEC3"
                                                         : "VEC4"}});
    json["bufferViews"].push_back({{"buffer", 0},
                                   {"byteOffset", parts.binary.size()},
                                   {"byteLength", bytes.size()},
                                   {"byteStride", stride}});
    json["meshes"][0]["primitives"][0]["attributes"]
        [std::string("KHR_gaussian_splatting:") + name] = json["accessors"].size() - 1;
    parts.binary += bytes;
  };
  put("SCALE", 5121, false, 4, {"\1\2\3\0\4\5\6\0", 8});                             // u8, padded
  put("ROTATION", 5122, true, 8, {"\0\0\0\0\xff\x7f\0\0\0\0\0\0\x01\x80\0\0", 16});  // z, then -z
  put("OPACITY", 5123, true, 4, {"\xff\x7f\0\0\0\x40\0\0", 8});
  parts.json["buffers"][0]["byteLength"] = parts.binary.size();
  const Gaussians g = read(parts).gaussians;
  EXPECT_EQ(g.log_scale[1].z, std::log(6.0f));
  EXPECT_EQ(g.log_scale[0].x, 0);
  EXPECT_EQ(std::abs(g.rotation[0].w), 1);  // half a turn about z, and that of the file
  EXPECT_EQ(std::abs(g.rotation[1].w), 1);
  EXPECT_NEAR(sigmoid(g.logit_opacity[0]), 0.5f, 1e-4f);
  EXPECT_NEAR(sigmoid(g.logit_opacity[1]), 0.25f, 1e-4f);
}

TEST_F(Glb, TheWorldOffsetOfItsNodeIsTaken) {
  GaussianModel model = random_model(3, 0);
  model.world_offset = {500'000, 5'400'000, 300.5};
  GlbParts parts = parts_of(model);
  EXPECT_EQ(read(parts).world_offset, model.world_offset);
  parts.json["nodes"][0]["extras"]["world_offset"] = {1, 2};
  EXPECT_THAT(error_with(parts), HasSubstr("not 3 numbers"));
}

}  // namespace
}  // namespace gs
