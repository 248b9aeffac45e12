// SPDX-License-Identifier: Apache-2.0
// The message for users whose card the build does not serve. No GPU is needed.
#include "cuda/device/unserved_card.h"

#include <gtest/gtest.h>

namespace gs::cuda {
namespace {

TEST(UnservedCard, NamesTheCardTheBuildAndTheCommandThatMendsIt) {
  EXPECT_EQ(unserved_card("NVIDIA A40", 86, {75, 90, 120}),
            "this build of gemsplat has no code that NVIDIA A40 (compute capability 8.6) and its "
            "driver can run: it was made for compute capability 7.5, 9.0, 12.0; build it for this "
            "card with `cmake --preset default -DGS_CUDA_ARCHITECTURES=86 && cmake --build "
            "--preset default`, for every card with the preset `portable`, or use --device cpu");
}

TEST(UnservedCard, AdvisesNoBuildForACardThatIsTooOld) {
  EXPECT_EQ(unserved_card("Tesla P100", 60, {90}),
            "gemsplat does not run on Tesla P100 (compute capability 6.0): it needs compute "
            "capability 7.5 or later; use another GPU (--device cuda:N) or --device cpu");
}

}  // namespace
}  // namespace gs::cuda
