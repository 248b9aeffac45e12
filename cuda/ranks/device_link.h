// SPDX-License-Identifier: Apache-2.0
// How the GPUs of ranks that are processes send device memory to each other. It has no CUDA types,
// so that any compiler can include it.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

struct CUstream_st;  // which cudaStream_t points to

namespace gs::cuda {

/// Thrown where a link was given up, because another rank is lost.
struct LinkLost {};

/// Bytes of this rank's GPU that another rank gets, or that come from it.
struct DevicePiece {
  int rank;  // the other one
  void* data;
  std::size_t bytes;
};

/// One rank's way to the GPUs of the others. All ranks make the same calls in the same order.
class DeviceLink {
 public:
  virtual ~DeviceLink() = default;
  /// Sends and receives, after what the stream does so far and before what it does next. The host
  /// need not wait for that. The first piece that rank a sends to rank b becomes the first one that
  /// b receives from a, and so on; each has as many bytes on both sides. Throws Error where a
  /// transfer cannot be started, and LinkLost.
  virtual void exchange(const std::vector<DevicePiece>& sent,
                        const std::vector<DevicePiece>& received, CUstream_st* stream) = 0;
  /// Throws Error where an earlier transfer has failed, and LinkLost after give_up().
  virtual void check() = 0;
  /// Ends all transfers, also those that wait for a rank that is lost: streams go on, and what was
  /// to be received is undefined. Any thread may call it, more than once.
  virtual void give_up() noexcept = 0;
};

/// How the ranks of a run come to their links.
class DeviceLinks {
 public:
  virtual ~DeviceLinks() = default;
  /// Rank 0: what the others must know to connect.
  virtual std::vector<std::byte> invitation() = 0;
  /// The link of a rank, on its GPU. All ranks call it at the same time. Calls keep_watch(), which
  /// may throw, while it waits for the others, and so may the link, as long as it lives. Throws
  /// Error.
  virtual std::unique_ptr<DeviceLink> connect(int device, int rank, int count,
                                              const std::vector<std::byte>& invitation,
                                              const std::function<void()>& keep_watch) = 0;
};

/// Links by NCCL, for ranks that are processes with a GPU each, of one machine or of several. The
/// library is loaded here, from the file that the environment variable GEMSPLAT_NCCL names, or
/// libnccl.so.2. Throws UsageError where it is missing, or too old.
std::unique_ptr<DeviceLinks> make_nccl_links();

/// Links between threads of one process, whose ranks may share a GPU: for tests. One for each rank.
std::vector<std::unique_ptr<DeviceLinks>> make_thread_links(int count);

}  // namespace gs::cuda
