// SPDX-License-Identifier: Apache-2.0
// What this build can do.
#pragma once

#include <string>
#include <vector>

namespace gs {

/// One thing that a build may have or lack.
struct Capability {
  std::string name;
  bool available;
  std::string detail;  // what it is for; where it lacks, what then cannot be done and how to get it
};

/// What this build, on this machine, can and cannot do: optional libraries and devices.
std::vector<Capability> capabilities();

}  // namespace gs
