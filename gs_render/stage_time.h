// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace gs {

/// The durations of one stage on a backend.
struct StageTime {
  std::string stage;
  std::vector<float> milliseconds;  // one per run
};

}  // namespace gs
