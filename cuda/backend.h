// SPDX-License-Identifier: Apache-2.0
// The public header of the CUDA backend. It has no CUDA types, so that any compiler can include it.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "cuda/gpus/shard.h"
#include "gs_render/operator.h"
#include "gs_train/backend.h"

namespace gs::cuda {

/// How many GPUs the driver reports; 0 where there is no driver.
int device_count();

/// Where there are none: what is missing, and what to do about it.
std::string why_no_gpu();

/// A process of a run, among others that train the same model.
struct Process {
  int rank = 0, count = 1;
  std::string meeting_file = {};  // on a disk that all share; process 0 writes it
  std::string advice = {};        // "; go on with ...", for the message where another one is lost
};

/// The backend of a GPU, 0 <= index < device_count(), or of several, which train one model together
/// (docs/method/several_gpus.md). A GPU that is named twice counts as two, for tests. Throws Error
/// where a GPU cannot be used, and UsageError where two of them cannot read each other's memory.
///
/// chunk_rows   2^k rows, at least 32; GPUs get the chunks of the model in turn
/// process      one of several that make the same calls, and each of which has a backend of as many
///              GPUs; waits for the others (docs/method/several_gpus.md#processes)
std::unique_ptr<Backend> make_backend(const std::vector<int>& devices,
                                      std::size_t chunk_rows = kChunkRows,
                                      const Process& process = {});

/// Drawing and its gradient on arrays of others; of any GPU, and for any thread.
const SplatOperator& splat_operator();

/// GPU memory that the backends of this process have allocated; for tests and benchmarks.
struct Usage {
  std::size_t allocated_bytes = 0;       // now
  std::size_t peak_allocated_bytes = 0;  // the most at any time
};
Usage usage();
/// The peak becomes what is allocated now.
void restart_peak();

}  // namespace gs::cuda
