// SPDX-License-Identifier: Apache-2.0
// density.region: half-spaces as text and in the coordinates of a scene.
#include "gs_core/config/text/region_text.h"

#include "tests/support/test.h"

namespace gs {
namespace {

TEST(Region, WithoutHalfSpacesIsAllOfSpace) {
  EXPECT_EQ(parse_region("")->size(), 0u);
  EXPECT_TRUE(region_of({}, {}).holds(Vec3f(std::numeric_limits<float>::quiet_NaN())));
}

TEST(Region, HoldsWhatIsInsideOfAllHalfSpacesAndTheirPlanes) {
  const Region region = region_in_scene(*parse_region("1,0,0,-2; -1, 0, 0, -3;0,0,2,1"), {});
  EXPECT_TRUE(region.holds({-2, 100, 0.5f}));
  EXPECT_TRUE(region.holds({3, -100, 7}));
  EXPECT_FALSE(region.holds({-2.001f, 0, 1}));
  EXPECT_FALSE(region.holds({3.001f, 0, 1}));
  EXPECT_FALSE(region.holds({0, 0, 0.499f}));
  EXPECT_FALSE(region.holds(Vec3f(std::numeric_limits<float>::quiet_NaN())));
}

TEST(Region, TextKeepsEveryBit) {
  const std::vector<WideHalfSpace> half_spaces = {{{0.1, 1.0 / 3, -2e-17}, 4.1e6 + 1e-9},
                                                  {{0.0, 0.0, 1.0}, 0}};
  const auto read = parse_region(text_of_region(half_spaces));
  ASSERT_TRUE(read);
  ASSERT_EQ(read->size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ((*read)[i].normal, half_spaces[i].normal);
    EXPECT_EQ((*read)[i].offset, half_spaces[i].offset);
  }
}

TEST(Region, StaysWhereItIsWhereASceneIsMovedNearTheOrigin) {
  const Vec3d offset(5.0e5, 5.3e6, 200.0);
  DensityConfig density;
  density.region = "0.6,0.8,0,4540010";
  const Region region = region_of(density, offset);
  EXPECT_TRUE(region.holds({10.1f, 5, 0}));  // 0.6 500,000 + 0.8 5,300,000 + 10.06
  EXPECT_FALSE(region.holds({9.9f, 5, 0}));
}

TEST(Region, OtherTextIsNone) {
  for (const char* text :
       {"1,0,0", "1,0,0,2,3", "1,0,x,2", "0,0,0,1", "1,0,0,inf", "1,0,0,nan", ";", "1,0,0,1;;", "a",
        "1,0,0,1;1,0,0,1;1,0,0,1;1,0,0,1;1,0,0,1;1,0,0,1;"
        "1,0,0,1"})
    EXPECT_FALSE(parse_region(text)) << text;
}

TEST(Region, ASettingThatIsNoneIsRefused) {
  Config config;
  apply_setting(config, "density.region=1,0,0");
  EXPECT_NE(error_of([&] { validate(config); }).find("density.region"), std::string::npos);
  EXPECT_NE(error_of([&] { region_of(config.density, {}); }).find("density.region"),
            std::string::npos);
  apply_setting(config, "density.region=1,0,0,5");
  validate(config);
}

}  // namespace
}  // namespace gs
