// SPDX-License-Identifier: Apache-2.0
// Several processes that train one model, on one machine or on several
// (docs/method/several_gpus.md#processes). All take the same steps of the same model by the same
// settings, and each draws some photos of a batch. So they only have to share what stage 6 leaves
// of a photo, and nothing else is said.
#pragma once

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "cuda/backend.h"
#include "cuda/gpus/gpu.cuh"
#include "cuda/gpus/nccl.h"

namespace gs::cuda {

/// This process among the others. NCCL carries what they share, and notices one that is gone: then
/// this process ends, at once and with one message, whatever it is doing. The last checkpoint stays.
class Processes {
 public:
  /// Meets the others: waits until all have come, a while at most. Each has as many GPUs. Throws
  /// UsageError where NCCL is missing.
  Processes(const Process& process, Gpus& gpus);
  ~Processes();
  Processes(const Processes&) = delete;
  Processes& operator=(const Processes&) = delete;

  std::size_t count() const { return std::size_t(process_.count); }
  /// Whether this process draws photo i of a batch.
  bool draws(std::size_t i) const { return i % count() == std::size_t(process_.rank); }

  /// Bytes on a GPU that one process has, and all others get, to the same place. The GPU has the
  /// same number in all processes.
  struct Piece {
    std::size_t from;  // the process
    std::size_t gpu;
    void* data;
    std::size_t bytes;
  };
  /// After what the streams of these GPUs do so far, and before what they do next. The host does not
  /// wait. All processes share the same pieces in the same order.
  void share(const std::vector<Piece>& pieces);
  /// All that was shared has come. A process that ends from here on, because its work is done, is
  /// noticed only where there is more to share.
  void rest() { is_sharing_ = false; }
  /// Throws Error where another process has another value; `what` completes "has other ...". Waits.
  void check_same(std::uint64_t value, const std::string& what);

 private:
  void connect();
  std::vector<NcclId> exchanged_ids() const;
  void watch();
  void end_watch();

  const Process process_;
  Gpus& gpus_;
  const Nccl nccl_;
  std::vector<NcclCommunicator*> communicators_;  // of each GPU with those of its number elsewhere
  std::atomic<bool> has_met_ = false, is_sharing_ = false;
  // of the thread that watches NCCL
  std::mutex mutex_;
  std::condition_variable changed_;
  bool is_over_ = false;
  std::thread watch_;
};

}  // namespace gs::cuda
