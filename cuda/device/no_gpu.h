// SPDX-License-Identifier: Apache-2.0
// The message for a machine on which this build finds no GPU.
#pragma once

#include <string>

namespace gs::cuda {

/// What CUDA's runtime says. Versions are 1000 major + 10 minor, as 12040 for CUDA 12.4.
struct NoGpu {
  int runtime_version = 0;  // that this build is linked with
  int driver_version = 0;   // the newest that the driver knows; 0: there is no driver
  bool is_old = false;      // cudaErrorInsufficientDriver
};

/// Says what is missing, and what to do about it.
std::string text_of(const NoGpu& no_gpu);

}  // namespace gs::cuda
