// SPDX-License-Identifier: Apache-2.0
// What the log says while a test does something, whatever tests before it have done with the log.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "gs_core/system/log.h"

namespace gs {

/// Everything that is logged from here to text(), which is called once.
class CapturedLog {
 public:
  CapturedLog() {
    setup_log(Verbosity::normal);
    testing::internal::CaptureStderr();
  }
  std::string text() { return testing::internal::GetCapturedStderr(); }
};

}  // namespace gs
