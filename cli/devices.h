// SPDX-License-Identifier: Apache-2.0
// From the name of a device to its backend; and what this build can do at all.
#pragma once

#include <memory>
#include <string>

#include "gs_train/backend.h"

namespace gs {

/// The backend for "cpu", "cuda", "cuda:N" or "auto" (a GPU where this build and machine have one, else the
/// CPU). Throws Error that says what is missing and how to get it.
std::unique_ptr<Backend> make_backend(const std::string& device);

/// One thing that a build may have or lack.
struct Capability {
  std::string name;
  bool available;
  std::string detail;  // what it is for; where it lacks, what then cannot be done and how to get it
};

/// What this build, on this machine, can and cannot do: optional libraries and devices.
std::vector<Capability> capabilities();

}  // namespace gs
