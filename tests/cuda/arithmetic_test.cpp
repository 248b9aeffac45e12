// SPDX-License-Identifier: Apache-2.0
// Quotients and square roots without a branch have the bits of those that IEEE 754 defines.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "cuda/backend.h"
#include "tests/cuda/arithmetic_kernels.h"

namespace gs {
namespace {

class BranchlessArithmetic : public testing::Test {
 protected:
  void SetUp() override {
    if (cuda::device_count() == 0) GTEST_SKIP() << "the driver reports no GPU";
  }
};

TEST_F(BranchlessArithmetic, AllRootsInTheRangeAreRounded) {
  EXPECT_EQ(differing_roots(0x1p-100f, 0x1p100f), 0u);
}

TEST_F(BranchlessArithmetic, QuotientsInTheRangeAreRounded) {
  EXPECT_EQ(differing_quotients(std::uint64_t(1) << 32, 49), 0u);
}

TEST_F(BranchlessArithmetic, ZeroIsARootAndANumerator) {
  EXPECT_EQ(root_on_gpu(0.0f), 0.0f);
  EXPECT_EQ(quotient_on_gpu(0.0f, -3.0f), 0.0f);
}

// A splat with such a number is not visible, as one with an infinity is not.
TEST_F(BranchlessArithmetic, WhatOverflowsIsNotFinite) {
  EXPECT_FALSE(std::isfinite(quotient_on_gpu(0x1p100f, 0x1p-100f)));
  EXPECT_FALSE(std::isfinite(quotient_on_gpu(1.0f, 0.0f)));
  EXPECT_FALSE(std::isfinite(root_on_gpu(std::numeric_limits<float>::infinity())));
  EXPECT_TRUE(std::isnan(root_on_gpu(std::numeric_limits<float>::quiet_NaN())));
}

}  // namespace
}  // namespace gs
