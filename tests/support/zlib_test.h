// SPDX-License-Identifier: Apache-2.0
// Tests of files that are compressed with zlib.
#pragma once

#include <gtest/gtest.h>

#include "gs_core/error.h"
#include "gs_model/formats/coding/compression.h"

namespace gs {

/// Skipped, with the reason, where this build has no zlib.
class ZlibTest : public testing::Test {
 protected:
  void SetUp() override {
    try {
      require_zlib();
    } catch (const Error& missing) {
      GTEST_SKIP() << missing.what();
    }
  }
};

}  // namespace gs
