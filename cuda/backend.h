// SPDX-License-Identifier: Apache-2.0
// The one public header of the CUDA backend; no CUDA type in it.
#pragma once

#include <memory>
#include <string>

#include "gs_train/backend.h"

namespace gs::cuda {

/// How many GPUs the driver reports; 0 where there is no driver.
int device_count();

/// The backend of GPU `index`, 0 <= index < device_count(). Throws Error where the GPU cannot be used.
std::unique_ptr<Backend> make_backend(int index);

/// What the backends of this process have asked of the driver so far; for tests and benchmarks.
struct Usage {
  std::size_t allocated_bytes = 0;       // now
  std::size_t peak_allocated_bytes = 0;  // at most, since the start
};
Usage usage();

}  // namespace gs::cuda
