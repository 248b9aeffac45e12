// SPDX-License-Identifier: Apache-2.0
// Runs that refine disturbed poses.
#include <gmock/gmock.h>
TEST(PosesRun, Placeholder) {}
