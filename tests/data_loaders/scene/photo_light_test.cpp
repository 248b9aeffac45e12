// SPDX-License-Identifier: Apache-2.0
// What photometric.model = "auto" chooses.
#include "data_loaders/scene/photo_light.h"

#include <gmock/gmock.h>

namespace gs {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

PhotometricChoice choice(double before, double after) {
  return choose_photometric(ExposureSummary{1000, before, after}, "");
}

// The spreads of the scenes that chose the limits.
TEST(PhotoLight, TakesGainsForSouthBuildingAndNotForTheFoxes) {
  EXPECT_TRUE(choice(0.082, 0.032).has_gains);
  EXPECT_FALSE(choice(0.051, 0.041).has_gains);
  EXPECT_FALSE(choice(0.058, 0.046).has_gains);
}

TEST(PhotoLight, NeedsPhotosThatDifferAndExposuresThatExplainIt) {
  EXPECT_TRUE(choice(0.061, 0.04).has_gains);
  EXPECT_FALSE(choice(0.059, 0.01).has_gains);
  EXPECT_FALSE(choice(0.2, 0.15).has_gains);
  EXPECT_FALSE(choice(0, 0).has_gains);
}

TEST(PhotoLight, SaysWhyWithBothSpreads) {
  EXPECT_THAT(choice(0.082, 0.032).why, StartsWith("the photos differ in light: a point's colors"));
  EXPECT_THAT(choice(0.082, 0.032).why, HasSubstr("8.2 %"));
  EXPECT_THAT(choice(0.082, 0.032).why, HasSubstr("3.2 %"));
  EXPECT_THAT(choice(0.05, 0.01).why, StartsWith("the photos hardly differ in light"));
  EXPECT_THAT(choice(0.2, 0.15).why, HasSubstr("light explains little of it"));
}

TEST(PhotoLight, TakesNoModelWhereExposuresAreNotKnown) {
  const PhotometricChoice unknown = choose_photometric(std::nullopt, "there is no Ceres");
  EXPECT_FALSE(unknown.has_gains);
  EXPECT_THAT(unknown.why, testing::EndsWith("because there is no Ceres"));
}

}  // namespace
}  // namespace gs
