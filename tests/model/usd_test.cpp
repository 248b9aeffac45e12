// SPDX-License-Identifier: Apache-2.0
// Stages of USD by other programs: what is read, and what is refused with a remedy. formats_test.cpp
// and golden_formats_test.cpp have our own files.
#include "gs_model/formats/usd/usd.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "gs_core/math/render/activations.h"
#include "gs_core/math/render/sh.h"
#include "gs_core/system/log.h"
#include "gs_model/edit/model_transform.h"
#include "gs_model/formats/coding/zip_file.h"
#include "gs_model/formats/formats.h"
#include "gs_model/formats/usd/usd_layer.h"
#include "tests/support/error_of.h"
#include "tests/support/random_model.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class Usd : public testing::Test {
 protected:
  static void SetUpTestSuite() { setup_log(Verbosity::quiet); }
  std::filesystem::path file(const std::string& name) const { return folder_.path() / name; }
  GaussianModel read(const std::string& text) const {
    write_bytes(file("a.usda"), text);
    return read_model(file("a.usda"));
  }
  std::string error_with(const std::string& text) const {
    return error_of([&] { read(text); });
  }
  /// A stage with a prim of these attributes.
  static std::string stage(const std::string& attributes, const std::string& metadata = "") {
    return "#usda 1.0\n(\n" + metadata + ")\ndef Xform \"World\"\n{\n" +
           "    def ParticleField3DGaussianSplat \"g\" {\n" + attributes + "\n    }\n}\n";
  }
  static constexpr const char* kOne = "point3f[] positions = [(1, 2, 3)]\n";

  TempFolder folder_;
};

TEST_F(Usd, WhatIsMissingOrTooShortHasTheDefaultsOfTheSchema) {
  for (const char* more :
       {"", "float3[] scales = [(1, 1)]\nquatf[] orientations\nfloat[] opacities = []",
        "float3[] radiance:sphericalHarmonicsCoefficients = [(1, 1, 1)]"}) {
    const GaussianModel model = read(stage(std::string(kOne) + more));
    const Gaussians& g = model.gaussians;
    ASSERT_EQ(g.count(), 1u);
    EXPECT_EQ(g.mean[0], Vec3f(-1, -2, 3));
    EXPECT_EQ(g.log_scale[0], Vec3f(0));
    EXPECT_EQ(std::abs(g.rotation[0].z), 1);  // half a turn about z
    EXPECT_GT(sigmoid(g.logit_opacity[0]), 0.999999f);
    EXPECT_EQ(model.sh_degree, 0);
    EXPECT_EQ(g.sh0[0], Vec3f(0));  // color 0.5
  }
}

TEST_F(Usd, HalfsAreReadWhereThereAreNoFloatsAndLongArraysAreCut) {
  const GaussianModel model = read(stage(R"(
    point3f[] positions = []
    point3h[] positionsh = [(1, 2, 3)]
    half3[] scalesh = [(2, 2, 2), (3, 3, 3)]
    half[] opacitiesh = [0.5, 0.25]
    float[] opacities = [0.75]
    uniform int radiance:sphericalHarmonicsDegree = 0
    half3[] radiance:sphericalHarmonicsCoefficientsh = [(1, 2, 3), (4, 5, 6)] ( elementSize = 1 )
    quath[] orientationsh = [(1, 0, 0, 0)])"));
  const Gaussians& g = model.gaussians;
  ASSERT_EQ(g.count(), 1u);
  EXPECT_EQ(g.log_scale[0].x, std::log(2.0f));
  EXPECT_NEAR(sigmoid(g.logit_opacity[0]), 0.75f, 1e-6f);
  EXPECT_EQ(g.sh0[0], Vec3f(1, 2, 3));
}

TEST_F(Usd, SyntaxOfOtherWritersIsRead) {
  const GaussianModel model = read(R"(#usda 1.0
( """A stage
with "quotes" and a ) bracket"""
    customLayerData = { dictionary a = { string b = "}" } }
    subLayers = [ @./other.usda@ (offset = 1) ]
    upAxis = 'Y' ; metersPerUnit = 0.01
)
# a comment with a { bracket
// another } of two
/* lines ( */
over "Empty" { }
class ParticleField3DGaussianSplat "_abstract" { point3f[] positions = [(0, 0, 0)] }
def Xform "World" (
    prepend references = @@@a@b.usda@@@</World{v=1}>
    variants = { string look = "red" }
)
{
    variantSet "look" = { "red" { color3f c = (1, 0, 0) } }
    reorder nameChildren = ["g"]
    rel material:binding = </World/Looks/a>
    custom asset x = @a.png@ (doc = "a ( b")
    prepend token outputs:surface.connect = </World/Looks/a.out>
    float y.timeSamples = { 0: 1, 1: None }
    double3 xformOp:translate = (0, 0, 0); float3 xformOp:scale = (1, 1, 1)
    float3 xformOp:rotateXYZ = (0, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
    def ParticleField3DGaussianSplat "g" ( active = true ) {
        point3f[] positions = [ # two
            (1e0, -2.5E-1, +.5), (4, 5, 6), ]
        float[] opacities = [.5, 1]
        bool visible = true
        string note = "line \" ends"
    }
}
)");
  ASSERT_EQ(model.gaussians.count(), 2u);
  EXPECT_EQ(model.gaussians.mean[0], Vec3f(-1, 0.25f, 0.5f));
}

TEST_F(Usd, TransformsOfItsParentsAndTheUpAxisTakeTheGaussiansAlong) {
  const GaussianModel model = random_model(20, 3);
  MemorySink sink("m");
  write_usda(sink, model, {});
  const std::size_t body = sink.text.find("{\n") + 2;
  // Rows for points as rows: a quarter turn about y, twice the size, and a shift.
  std::string moved = sink.text;
  moved.insert(body,
               "double3 xformOp:translate = (0, 0, 10)\nmatrix4d xformOp:transform:a = ((0, 0, -2, "
               "0), (0, 2, 0, 0), (2, 0, 0, 0), (1, 2, 3, 1))\n"
               "uniform token[] xformOpOrder = [\"xformOp:translate\", \"xformOp:transform:a\"]\n");
  const GaussianModel back = read(moved);
  const double half = std::sqrt(0.5);
  // In the PLY's axes, which have x and y the other way round.
  GaussianModel expected = read(sink.text);
  transform_model(expected, {{0, 0, 0}, {half, 0, -half, 0}, 2});
  for (std::size_t i = 0; i < 20; ++i) {
    const Vec3f& mean = model.gaussians.mean[i];
    const Vec3f in_stage = {-mean.x, -mean.y, mean.z};
    const Vec3f there = {2 * in_stage.z + 1, 2 * in_stage.y + 2, -2 * in_stage.x + 13};
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(back.gaussians.mean[i][axis], (there * Vec3f(-1, -1, 1))[axis], 1e-4f);
      EXPECT_NEAR(back.gaussians.log_scale[i][axis], expected.gaussians.log_scale[i][axis], 1e-5f);
      for (int k = 0; k < kShRestCount; ++k)
        EXPECT_NEAR(back.gaussians.sh_rest[i].coefficient[k][axis],
                    expected.gaussians.sh_rest[i].coefficient[k][axis], 1e-5f);
    }
  }
  // A stage with z up: its z is the other one's y.
  std::string z_up = sink.text;
  z_up.replace(z_up.find("upAxis = \"Y\""), 12, "upAxis = \"Z\"");
  const Vec3f first = model.gaussians.mean[0];
  const Vec3f turned = read(z_up).gaussians.mean[0];
  EXPECT_NEAR(turned.x, first.x, 1e-5f);
  EXPECT_NEAR(turned.y, -first.z, 1e-5f);
  EXPECT_NEAR(turned.z, first.y, 1e-5f);
}

TEST_F(Usd, AllLayersOfAPackageAreLookedThroughAndItsBytesAreAligned) {
  const GaussianModel model = random_model(3, 1);
  for (const char* name : {"a.usda", "a.usdc", "a.usdz"}) write_model(file(name), model);
  const std::string package = read_bytes(file("a.usdz"));
  EXPECT_EQ(package.find("PXR-USDC") % 64, 0u);
  EXPECT_EQ(package.substr(30, 10), "model.usdc");
  for (const char* layer : {"a.usda", "a.usdc"}) {
    write_bytes(file("b.usdz"),
                zip_of({{"default.usda", "#usda 1.0\nover \"a\" (references = @g.usda@) {}\n"},
                        {std::string("parts/g").append(layer + 1), read_bytes(file(layer))},
                        {"a.png", "a picture"}}));
    EXPECT_EQ(read_model(file("b.usdz")).gaussians.count(), 3u) << layer;
  }
}

void expect_same(const std::vector<UsdPrim>& a, std::vector<UsdPrim> b) {
  ASSERT_EQ(a.size(), b.size());
  for (const UsdPrim& prim : a) {
    const auto other =
        std::find_if(b.begin(), b.end(), [&](const UsdPrim& one) { return one.name == prim.name; });
    ASSERT_NE(other, b.end()) << prim.name;
    EXPECT_EQ(other->type, prim.type);
    EXPECT_EQ(other->attributes.size(), prim.attributes.size()) << prim.name;
    for (const UsdAttribute& attribute : prim.attributes) {
      const UsdValue* value = other->find(attribute.name);
      ASSERT_TRUE(value) << attribute.name;
      EXPECT_EQ(value->type, attribute.value.type);
      EXPECT_EQ(value->floats, attribute.value.floats) << attribute.name;
      EXPECT_EQ(value->doubles, attribute.value.doubles) << attribute.name;
      EXPECT_EQ(value->words, attribute.value.words) << attribute.name;
    }
    expect_same(prim.children, other->children);
  }
}

TEST_F(Usd, BytesAndTextHoldTheSamePrims) {
  GaussianModel model = random_model(9, 2);
  model.antialiased = true;
  model.world_offset = {1, 2, 300'000.125};
  const Camera camera{40, 30, 50, 50, 20, 15};
  ExportOptions options;
  options.views = {{"a", camera}, {"b", camera}, {"a", camera}};
  for (const char* name : {"a.usda", "a.usdc", "b.usd"}) write_model(file(name), model, options);
  const UsdLayer text = parse_usda("", read_bytes(file("a.usda")));
  const UsdLayer bytes = parse_usdc("", read_bytes(file("a.usdc")));
  EXPECT_EQ(text.up_axis, bytes.up_axis);
  expect_same(text.prims, bytes.prims);
  EXPECT_EQ(read_bytes(file("b.usd")), read_bytes(file("a.usdc")));
}

// Files of tests/fuzz/corpus/usd: `compressed` was made by a script apart from our writer, with all
// that OpenUSD does: tables with differences of 0, 1 and 2 bytes, LZ4 blocks that repeat what they
// had, numbers of a table, and values in 48 bits. OpenUSD made `crate_of_openusd` of it.
TEST_F(Usd, CompressedBytesOfOtherWritersAreRead) {
  const std::filesystem::path corpus = std::filesystem::path(GS_SOURCE_DIR) / "tests/fuzz/corpus";
  for (const char* name : {"usd/compressed", "usd/crate_of_openusd"}) {
    SCOPED_TRACE(name);
    write_bytes(file("a.usdc"), read_bytes(corpus / name));
    const GaussianModel model = read_model(file("a.usdc"));
    const Gaussians& g = model.gaussians;
    ASSERT_EQ(g.count(), 20u);
    for (std::size_t i = 0; i < 20; ++i) {
      EXPECT_EQ(g.mean[i], Vec3f(-float(i) - 1, -2, 3)) << i;  // shifted by 1 2 3
      EXPECT_NEAR(sigmoid(g.logit_opacity[i]), i % 2 ? 0.25f : 0.75f, 1e-6f) << i;
      EXPECT_NEAR(g.log_scale[i].x, std::log(0.5f), 1e-6f);
      EXPECT_EQ(std::abs(g.rotation[i].w), 1);  // half a turn about z, and back
      EXPECT_EQ(g.sh0[i], Vec3f(float(i % 3), 1, 0));
    }
  }
}

TEST_F(Usd, DamagedBytesAreAnErrorWithARemedy) {
  write_model(file("a.usdc"), random_model(3, 0));
  std::string bytes = read_bytes(file("a.usdc"));
  const auto error_of_bytes = [&](const std::string& damaged) {
    write_bytes(file("b.usdc"), damaged);
    return error_of([&] { read_model(file("b.usdc")); });
  };
  EXPECT_THAT(error_of_bytes(bytes.substr(0, bytes.size() - 1)),
              AllOf(HasSubstr("cut short or damaged"), HasSubstr("export it again")));
  bytes[9] = 6;
  EXPECT_THAT(error_of_bytes(bytes), AllOf(HasSubstr("of version 0.6"), HasSubstr("usdcat FILE")));
}

TEST_F(Usd, TheWorldOffsetIsKept) {
  GaussianModel model = random_model(3, 0);
  model.world_offset = {500'000, 5'400'000, 300.5};
  write_model(file("a.usda"), model);
  EXPECT_EQ(read_model(file("a.usda")).world_offset, model.world_offset);
  EXPECT_THAT(error_with(stage(std::string(kOne) + "double3 gemsplat:worldOffset = (1, 2)")),
              HasSubstr("not 3 numbers"));
}

TEST_F(Usd, WhatCannotBeReadIsRefusedWithARemedy) {
  EXPECT_THAT(error_with("#usda 1.0\ndef Mesh \"m\" {}\n"),
              AllOf(HasSubstr("no prim of type ParticleField3DGaussianSplat"),
                    HasSubstr("usdcat --flatten")));
  EXPECT_THAT(error_with(stage(kOne) + stage(kOne).substr(12)), HasSubstr("line"));
  EXPECT_THAT(error_with(stage(std::string(kOne) + "}\ndef ParticleField3DGaussianSplat \"h\" {")),
              AllOf(HasSubstr("several prims"), HasSubstr("join them")));
  EXPECT_THAT(error_with(stage("")), HasSubstr("no positions"));
  EXPECT_THAT(error_with(stage("point3f[] positions.timeSamples = {0: [(1, 2, 3)]}")),
              AllOf(HasSubstr("positions change in time"), HasSubstr("one moment")));
  EXPECT_THAT(
      error_with(stage(std::string(kOne) + "uniform token colorSpace:name = \"lin_rec709_scene\"")),
      AllOf(HasSubstr("colors are linear"), HasSubstr("srgb_rec709_display")));
  EXPECT_THAT(error_with(stage(std::string(kOne) + "int radiance:sphericalHarmonicsDegree = 4")),
              AllOf(HasSubstr("SH degree is 4"), HasSubstr("degree 3")));
  const auto with_op = [&](const std::string& op, const std::string& value) {
    return error_with(stage(kOne + op + " = " + value + "\ntoken[] xformOpOrder = [\"" +
                            op.substr(op.find(' ') + 1) + "\"]"));
  };
  EXPECT_THAT(with_op("float3 xformOp:rotateXYZ", "(0, 90, 0)"),
              AllOf(HasSubstr("no matrix and no shift"), HasSubstr("apply it")));
  EXPECT_THAT(with_op("matrix4d xformOp:transform",
                      "((1, 0, 0, 0), (0, 2, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))"),
              AllOf(HasSubstr("scales unevenly"), HasSubstr("apply it")));
}

TEST_F(Usd, DamagedTextIsAnErrorWithItsLine) {
  const auto line_of = [&](const std::string& text) {
    const std::string error = error_with(text);
    EXPECT_THAT(error, HasSubstr("export it again"));
    return error.substr(error.find("line"), 50);
  };
  EXPECT_THAT(line_of("PXR"), HasSubstr("line 1 begins without #usda"));
  EXPECT_THAT(line_of("#usda 1.0\n(\n"), HasSubstr("ends in the metadata"));
  EXPECT_THAT(line_of("#usda 1.0\n\ndef Xform \"a\"\n{\n"), HasSubstr("line 5 ends in the prim a"));
  EXPECT_THAT(line_of(stage("point3f[] positions = [(1, x, 3)]")),
              HasSubstr("line 7 has x in place"));
  EXPECT_THAT(line_of(stage("point3f[] positions = [(1, 2")), HasSubstr("line 8 has } in place"));
  EXPECT_THAT(line_of(stage("string a = \"")), HasSubstr("a text that does not end"));
  EXPECT_THAT(line_of(stage("dictionary a = [{(")), HasSubstr("a bracket that is not"));
  EXPECT_THAT(line_of(stage("$")), HasSubstr("has $ where a prim"));
  EXPECT_THAT(line_of("#usda 1.0\n}"), HasSubstr("line 2 has } where a prim"));
  std::string deep = "#usda 1.0\n";
  for (int i = 0; i < 10'000; ++i) deep += "def Xform \"a\" {";
  EXPECT_THAT(line_of(deep), HasSubstr("in more than 100"));
}

}  // namespace
}  // namespace gs
