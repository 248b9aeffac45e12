// SPDX-License-Identifier: Apache-2.0
// Where NCCL is looked for. No GPU is needed for that.
#include "cuda/gpus/nccl.h"

#include <cstdlib>

#include "tests/support/test.h"

namespace gs {
namespace {

class Nccl : public testing::Test {
 protected:
  void TearDown() override { ::unsetenv("GEMSPLAT_NCCL"); }
  static void load(const char* file) {
    ::setenv("GEMSPLAT_NCCL", file, 1);
    cuda::load_nccl();
  }
};

TEST_F(Nccl, ThatIsMissingIsSaidWithTheRemedy) {
  EXPECT_THAT(error_of([] { load("/nowhere/libnccl.so.2"); }),
              AllOf(HasSubstr("/nowhere/libnccl.so.2"), HasSubstr("libnccl2"),
                    HasSubstr("GEMSPLAT_NCCL"), HasSubstr("--gpus N")));
  EXPECT_THROW(load("/nowhere/libnccl.so.2"), UsageError);
}

TEST_F(Nccl, IsNotTakenFromAnyOtherLibrary) {
  EXPECT_THAT(error_of([] { load("libm.so.6"); }),
              AllOf(HasSubstr("libm.so.6 has no function nccl"), HasSubstr("GEMSPLAT_NCCL")));
}

}  // namespace
}  // namespace gs
