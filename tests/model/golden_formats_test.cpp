// SPDX-License-Identifier: Apache-2.0
// Files of one Gaussian, compared with bytes worked out by hand from the specifications. Reading
// back a written file cannot find a mistake that writer and reader share; these tests do.
#include <gmock/gmock.h>

#include <cmath>

#include "gs_core/system/version.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/formats.h"
#include "tests/support/random_model.h"
#include "tests/support/temp_folder.h"
#include "tests/support/zlib_test.h"

namespace gs {
namespace {

/// One Gaussian of SH degree 1 with numbers that are easy to recognize in the files.
GaussianModel one_gaussian() {
  GaussianModel model = random_model(1, 1);
  const Gaussians& g = model.gaussians;
  g.mean[0] = {1.5f, -2.25f, 0.5f};
  g.log_scale[0] = {-1, 0, 2.5f};
  g.rotation[0] = {0.8f, 0, 0.6f, 0};  // w x y z
  g.logit_opacity[0] = 0;
  g.sh0[0] = {0, 1, -1};
  g.sh_rest[0] = {};
  g.sh_rest[0].coefficient[0] = {0.5f, -0.5f, 0};
  g.sh_rest[0].coefficient[1] = {0.25f, 0, 0};
  g.sh_rest[0].coefficient[2] = {0, 0, -0.25f};
  model.antialiased = true;
  return model;
}

std::string bytes_of(std::initializer_list<int> values) {
  std::string bytes;
  for (const int value : values) bytes += char(value);
  return bytes;
}

// The content of versions 2 and 3 before gzip; x right, y up, z backwards.
std::string spz_bytes(int version, const std::string& rotation) {
  return bytes_of({'N', 'G', 'S', 'P', version, 0, 0, 0,  //
                   1, 0, 0, 0,                            // count
                   1, 12, 1, 0}) +                        // degree, fractional bits, antialiased
         bytes_of({0x00, 0x18, 0x00,                      // 1.5 * 4096
                   0x00, 0x24, 0x00,                      // 2.25 * 4096
                   0x00, 0xF8, 0xFF}) +                   // -0.5 * 4096
         bytes_of({0x80}) +                               // half opaque
         bytes_of({0x80, 0xA6, 0x59}) +                   // 127.5 + 38.25 sh0
         bytes_of({144, 160, 200}) +                      // 16 (10 + log scale)
         rotation +                                       //
         bytes_of({0x40, 0xC0, 0x80,                      // 128 + 128 c; basis -y: sign turns
                   0x60, 0x80, 0x80,                      // basis z: sign turns
                   0x80, 0x80, 0x60});                    // basis -x: sign stays
}

// Largest w (3), x 0, y -0.6 = 434/511 sqrt(1/2) with its sign bit, z 0: 3 << 30 | 0x3B2 << 10.
const std::string kSmallestThree = bytes_of({0x00, 0xC8, 0x0E, 0xC0});

class Golden : public ZlibTest {
 protected:
  std::filesystem::path file(const char* name) const { return folder_.path() / name; }
  TempFolder folder_;
};

void expect_the_gaussian(const GaussianModel& back, float angle_tolerance) {
  const GaussianModel model = one_gaussian();
  ASSERT_EQ(back.gaussians.count(), 1u);
  EXPECT_EQ(back.sh_degree, 1);
  EXPECT_TRUE(back.antialiased);
  EXPECT_EQ(back.gaussians.mean[0], model.gaussians.mean[0]);
  EXPECT_EQ(back.gaussians.log_scale[0], model.gaussians.log_scale[0]);
  EXPECT_NEAR(back.gaussians.logit_opacity[0], 0, 0.01);
  EXPECT_NEAR(back.gaussians.rotation[0].w, 0.8f, angle_tolerance);
  EXPECT_NEAR(back.gaussians.rotation[0].y, 0.6f, angle_tolerance);
  EXPECT_NEAR(back.gaussians.sh0[0].y, 1, 0.01);
  for (int k = 0; k < 3; ++k)
    EXPECT_EQ(back.gaussians.sh_rest[0].coefficient[k], model.gaussians.sh_rest[0].coefficient[k])
        << k;
}

TEST_F(Golden, SpzVersion3HasTheseBytes) {
  write_model(file("a.spz"), one_gaussian());
  const std::string expected = spz_bytes(3, kSmallestThree);
  EXPECT_EQ(gunzip(file("a.spz"), read_bytes(file("a.spz")), expected.size(), true), expected);
  expect_the_gaussian(read_model(file("a.spz")), 0.001f);
}

TEST_F(Golden, SpzVersion2IsReadFromTheseBytes) {
  const std::string rotation = bytes_of({0x80, 0x33, 0x80});  // x y z as 127.5 + 127.5 v
  write_bytes(file("a.spz"), gzip(spz_bytes(2, rotation)));
  expect_the_gaussian(read_model(file("a.spz")), 0.005f);
}

TEST_F(Golden, GlbHasTheseBytes) {
  GaussianModel model = one_gaussian();
  model.gaussians.log_scale[0] = Vec3f(0);  // exp() of other numbers differs by the library
  write_model(file("a.glb"), model);
  const std::string bytes = read_bytes(file("a.glb"));

  // Half a turn about z: x and y change their signs, and so do the SH coefficients that belong to
  // them.
  std::string binary;
  for (const float value : {-1.5f, 2.25f, 0.5f}) append_little(binary, value);
  binary += bytes_of({55, 146, 10, 128});  // 0.5, 0.782, 0.218 of sRGB in linear light; opacity
  for (const float value : {-0.6f, 0.0f, 0.8f, -0.0f}) append_little(binary, value);  // x y z w
  for (const float value : {1.0f, 1.0f, 1.0f}) append_little(binary, value);
  append_little(binary, 0.5f);
  for (const float value : {0.0f, 1.0f, -1.0f}) append_little(binary, value);
  for (const float value : {-0.5f, 0.5f, -0.0f}) append_little(binary, value);
  for (const float value : {0.25f, 0.0f, 0.0f}) append_little(binary, value);
  for (const float value : {-0.0f, -0.0f, 0.25f}) append_little(binary, value);
  ASSERT_GT(bytes.size(), binary.size());
  EXPECT_EQ(bytes.substr(bytes.size() - binary.size()), binary);

  const auto word = [&](std::size_t at) { return load_little<std::uint32_t>(bytes.data() + at); };
  EXPECT_EQ(bytes.substr(0, 4), "glTF");
  EXPECT_EQ(word(4), 2u);
  EXPECT_EQ(word(8), bytes.size());
  const std::size_t json_bytes = word(12);
  EXPECT_EQ(bytes.substr(16, 4), "JSON");
  EXPECT_EQ(word(20 + json_bytes), binary.size());
  EXPECT_EQ(bytes.substr(24 + json_bytes, 4), std::string("BIN\0", 4));
  const std::string json = bytes.substr(20, json_bytes);
  EXPECT_THAT(json, testing::StartsWith(
                        std::string(R"({"asset":{"version":"2.0","generator":"gemsplat )") +
                        kVersion + R"("},"extensionsUsed":["KHR_gaussian_splatting"],"scene":0,)"));
  EXPECT_THAT(json, testing::HasSubstr(R"("mode":0,"attributes":{"POSITION":0,"COLOR_0":1,)"
                                       R"("KHR_gaussian_splatting:ROTATION":2,)"
                                       R"("KHR_gaussian_splatting:SCALE":3,)"));
  EXPECT_THAT(json, testing::HasSubstr(R"("min":[-1.5,2.25,0.5],"max":[-1.5,2.25,0.5])"));
  EXPECT_THAT(json, testing::HasSubstr(R"("nodes":[{"mesh":0}])"));

  model.world_offset = {500'000, 5'400'000, 300.5};
  write_model(file("far.glb"), model);
  EXPECT_THAT(read_bytes(file("far.glb")),
              testing::HasSubstr(R"("extras":{"world_offset":[500000.0,5400000.0,300.5]})"));
}

// Half a turn about z, as in a .glb; the quaternion begins with its real part, and each Gaussian
// has its SH coefficients behind each other.
TEST_F(Golden, UsdaHasThisText) {
  GaussianModel model = one_gaussian();
  model.gaussians.log_scale[0] = Vec3f(0);
  Camera camera{288, 100, 400, 400, 144, 60};
  camera.cam_from_world_translation = {1, 2, 3};
  ExportOptions options;
  options.views = {{"a/b c.jpg", camera}};
  write_model(file("a.usda"), model, options);
  EXPECT_EQ(read_bytes(file("a.usda")), std::string(R"(#usda 1.0
(
    defaultPrim = "Scene"
    doc = "gemsplat )") + kVersion + R"("
    metersPerUnit = 1
    upAxis = "Y"
)

def Xform "Scene"
{

    def ParticleField3DGaussianSplat "Gaussians" (
        prepend apiSchemas = ["ColorSpaceAPI"]
    )
    {
        uniform token colorSpace:name = "srgb_rec709_display"
        float3[] extent = [(-4.5, -0.75, -2.5), (1.5, 5.25, 3.5)]
        point3f[] positions = [(-1.5, 2.25, 0.5)]
        quatf[] orientations = [(-0, -0.6, 0, 0.8)]
        float3[] scales = [(1, 1, 1)]
        float[] opacities = [0.5]
        uniform int radiance:sphericalHarmonicsDegree = 1
        float3[] radiance:sphericalHarmonicsCoefficients = [(0, 1, -1), (-0.5, 0.5, -0), (0.25, 0, 0), (-0, -0, 0.25)] (
            elementSize = 4
        )
        uniform token projectionModeHint = "perspective"
        uniform token sortingModeHint = "zDepth"
        custom bool gemsplat:antialiased = 1
    }

    def Scope "Cameras"
    {

        def Camera "view_0_a_b_c_jpg"
        {
            float2 clippingRange = (0.01, 100000)
            float focalLength = 50
            float horizontalAperture = 36
            float horizontalApertureOffset = 0
            float verticalAperture = 12.5
            float verticalApertureOffset = 1.25
            matrix4d xformOp:transform = ((-1, -0, 0, 0), (0, 1, -0, 0), (0, 0, -1, 0), (1, 2, -3, 1))
            uniform token[] xformOpOrder = ["xformOp:transform"]
        }
    }
}
)");
}

}  // namespace
}  // namespace gs
