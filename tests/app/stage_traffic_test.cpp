// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checks/stage_traffic.h"

#include <gtest/gtest.h>

namespace gs {
namespace {

Workload one_visible_of_three() {
  Workload work;
  work.gaussians = 3;
  work.visible = 1;
  return work;
}

// Of each Gaussian shape (44 bytes), SH degree 0 (12), count and key (4 each); of the visible one
// the other SH coefficients (180), the splat (48) and its rectangle (8).
TEST(StageTraffic, TheFirstStageReadsShapesOfAllAndColorsOfTheVisible) {
  const Workload work = one_visible_of_three();
  EXPECT_EQ(stage_bytes("preprocess", work), 3 * (44 + 12 + 4 + 4) + 180 + 48 + 8);
}

// Each Gaussian has its count, and 59 parameters with moments to read and write; the visible one
// gradients of 48 bytes to read and clear, its color, and two statistics to read and write.
TEST(StageTraffic, AnUpdateMovesTheBytesOfTheMoments) {
  Workload work = one_visible_of_three();
  const double of_visible = 2 * 48 + 12 + 2 * 8;
  const auto bytes_with = [&](MomentStorage form) {
    work.moments = form;
    return stage_bytes("preprocess backward, Adam", work);
  };
  EXPECT_EQ(bytes_with(MomentStorage::floats), 3 * (1416 + 4) + of_visible);
  EXPECT_EQ(bytes_with(MomentStorage::halves), 3 * (708 + 4) + of_visible);
}

TEST(StageTraffic, StagesThatArithmeticLimitsHaveNone) {
  EXPECT_FALSE(stage_bytes("blend", one_visible_of_three()).has_value());
}

}  // namespace
}  // namespace gs
