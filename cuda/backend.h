// SPDX-License-Identifier: Apache-2.0
// The public header of the CUDA backend, with device_link.h. It has no CUDA types, so that any
// compiler can include it.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "cuda/ranks/device_link.h"
#include "gs_train/backend.h"
#include "gs_train/ranks/deal.h"
#include "gs_train/ranks/peer_ranks.h"

namespace gs::cuda {

/// How many GPUs the driver reports; 0 where there is no driver.
int device_count();

/// Where there are none: what is missing, and what to do about it.
std::string why_no_gpu();

/// The backend of GPU `index`, 0 <= index < device_count(). Throws Error where the GPU cannot be
/// used.
std::unique_ptr<Backend> make_backend(int index);

/// The backend of several GPUs that train one model together (docs/ranks.md#gpus). A GPU that is
/// named twice has two ranks. Throws UsageError where they cannot read each other's memory.
///
/// chunk_rows   2^k rows, at least 32; ranks get the chunks of the model in turn
std::unique_ptr<Backend> make_ranked_backend(const std::vector<int>& devices,
                                             std::size_t chunk_rows = kChunkRows);

/// The same where each rank is a process with a GPU: that of rank 0, which is a rank itself, on GPU
/// `device`. The processes behind `peers`, those of ranks 1, 2 and so on, call work_as_gpu_rank().
/// They are told of views with the first upload_views(). A rank that throws, ends or hangs ends the
/// run: step() and everything after it throws Error that names it. That holds for memory that runs
/// out, too.
std::unique_ptr<Backend> make_process_backend(int device, std::vector<PeerSocket> peers,
                                              PeerRules rules, std::unique_ptr<DeviceLinks> links,
                                              std::size_t chunk_rows = kChunkRows);

/// The work of another rank, on GPU `device`, as work_as_rank() is on the CPU: returns when rank 0
/// ends the run. Throws PeerLost where rank 0 was lost, and, after it has told rank 0, what else
/// went wrong.
///
/// views   the same as rank 0 has
void work_as_gpu_rank(int device, PeerSocket& leader, int rank, int count, double deadline,
                      const std::vector<View>& views, const PhotometricConfig& photometric,
                      std::unique_ptr<DeviceLinks> links);

/// GPU memory that the backends of this process have allocated; for tests and benchmarks.
struct Usage {
  std::size_t allocated_bytes = 0;       // now
  std::size_t peak_allocated_bytes = 0;  // the most at any time
};
Usage usage();
/// The peak becomes what is allocated now.
void restart_peak();

}  // namespace gs::cuda
