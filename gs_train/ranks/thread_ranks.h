// SPDX-License-Identifier: Apache-2.0
// Ranks as threads of this process, and what happens when one of them throws or hangs.
#pragma once

#include <chrono>
#include <functional>
#include <memory>

#include "gs_train/ranks/communicator.h"

namespace gs {

/// Runs the same work on several threads, each with a Communicator.
class ThreadRanks {
 public:
  using Seconds = std::chrono::duration<double>;
  /// `deadline`: a rank that works for so long without a call of its Communicator has hung.
  ThreadRanks(int count, Seconds deadline) : count_(count), deadline_(deadline) {}
  int count() const { return count_; }

  /// Calls work(communicator) on a thread for each rank, and returns when all have returned. Where
  /// a rank throws, the others end at their next call of the Communicator, and this throws Error
  /// with the message and the exit code of the first that failed, and its number. Where one hangs,
  /// this throws Error within about the deadline and leaves its thread behind. The thread then
  /// keeps its copy of `work`, so whatever the work uses must be owned by it. After that no rank
  /// runs again.
  void run(const std::function<void(Communicator&)>& work);
  /// Whether a rank has hung and its thread was left behind.
  bool has_lost_rank() const { return has_lost_rank_; }

 private:
  const int count_;
  const Seconds deadline_;
  bool has_lost_rank_ = false;
};

}  // namespace gs
