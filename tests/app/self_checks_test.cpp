// SPDX-License-Identifier: Apache-2.0
// The comparison of two backends, on a machine without a GPU: the scalar backend with itself.
#include "gs_app/checks/self_checks.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace gs {
namespace {

TEST(ParityChecks, FindNoDifferenceOfABackendFromItself) {
  const auto backend = make_scalar_backend();
  const std::vector<SelfCheck> checks = parity_checks(*backend);
  for (const SelfCheck& check : checks) {
    EXPECT_EQ(check.largest, 0) << check.what;
    EXPECT_GT(check.numbers, 0u) << check.what;
  }
  for (const char* what : {"step: mean", "step with half moments: mean",
                           "step with half moments: first moments", "relocation: mean"})
    EXPECT_TRUE(std::ranges::any_of(checks, [what](const SelfCheck& check) {
      return check.what == what;
    })) << what;
}

}  // namespace
}  // namespace gs
