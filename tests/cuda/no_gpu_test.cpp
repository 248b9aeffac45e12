// SPDX-License-Identifier: Apache-2.0
// The message for users on whose machine no GPU is found. No GPU is needed.
#include "cuda/device/no_gpu.h"

#include <gtest/gtest.h>

namespace gs::cuda {
namespace {

TEST(NoGpu, AMachineWithoutDriverIsToldToInstallOne) {
  EXPECT_EQ(text_of({13000, 0, true}),
            "this machine has no NVIDIA driver, or it is not loaded; install the driver, and see "
            "that nvidia-smi lists the GPU");
}

TEST(NoGpu, AnOldDriverIsNamedWithWhatThisBuildNeeds) {
  EXPECT_EQ(text_of({13000, 12040, true}),
            "the NVIDIA driver is too old: it knows CUDA up to 12.4, and this build of gemsplat "
            "needs 13.0; install a newer driver");
}

TEST(NoGpu, ADriverWithoutGpuPointsToWhatHidesIt) {
  EXPECT_EQ(text_of({12090, 13000, false}),
            "the driver reports no GPU; check nvidia-smi, and CUDA_VISIBLE_DEVICES if it is set");
}

}  // namespace
}  // namespace gs::cuda
