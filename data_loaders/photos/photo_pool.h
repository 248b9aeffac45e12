// SPDX-License-Identifier: Apache-2.0
// The photos of a scene that does not fit into its memory budget: threads decode them shortly
// before they are asked for, and they stay until other photos need the memory.
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "gs_core/scene.h"

namespace gs {

/// Bytes of one view: of its decoded photo, and at most while it is being decoded.
struct PhotoCost {
  std::size_t held = 0, decoding = 0;
};

/// A PhotoSource within a budget of bytes. Owned by the views that it serves.
///
/// Photos are dropped in this order when another one needs memory:
///   1. released photos;
///   2. the photo asked for most recently: each epoch takes every view once, so its next turn comes
///      after that of all others. In a scene of twice the budget, half of the photos are then found
///      decoded; dropping the photo asked for first instead leaves 15 %;
///   3. prefetched photos, the last one first, but only for a photo that a caller is waiting for.
/// A photo in use stays.
class PhotoPool final : public PhotoSource {
 public:
  using Decode = std::function<View(std::size_t index)>;  // called from several threads; may throw

  /// `budget_bytes` is at least least_budget(costs). The bytes of all photos, decoded or being
  /// decoded, stay below it while callers hold at most one pointer of view().
  PhotoPool(std::vector<PhotoCost> costs, Decode decode, std::size_t budget_bytes, int threads);
  ~PhotoPool() override;

  std::shared_ptr<const View> view(std::size_t index) override;
  void prefetch_decode(std::size_t index) override;
  void release(std::size_t index) override;

  /// The bytes of one photo in use while another one is decoded.
  static std::size_t least_budget(const std::vector<PhotoCost>& costs);

  struct Counts {
    std::size_t live_bytes, peak_bytes, decoded;  // now, most so far; photos decoded so far
  };
  Counts counts() const;

 private:
  enum class State { absent, decoding, present };
  struct Entry {
    State state = State::absent;
    std::shared_ptr<const View> view;
    std::uint64_t asked = 0;     // number of the last view() of it
    std::uint64_t expected = 0;  // number of its last expectation
    int expectations = 0;        // not yet fulfilled
    int waiting = 0;             // calls of view() that have not returned yet
    bool released = false;
    bool has_failed = false;  // in a thread of ours: the next view() tries again, and says why
  };

  void serve();
  std::size_t next_expected() const;
  bool free_bytes_for(std::size_t bytes, bool at_any_cost);
  std::size_t first_to_drop(bool at_any_cost) const;
  void decode(std::size_t index, std::unique_lock<std::mutex>& lock);
  void reserve(std::size_t bytes);
  void fulfill(std::size_t index);

  const std::vector<PhotoCost> costs_;
  const Decode decode_;
  const std::size_t budget_bytes_;
  const int thread_count_;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Entry> entries_;
  std::deque<std::size_t> expected_;  // in order
  std::size_t live_bytes_ = 0, peak_bytes_ = 0, decoded_ = 0;
  int decoding_ = 0;
  std::uint64_t calls_ = 0;
  bool quit_ = false;
  bool has_started_ = false;          // from the first expectation on
  std::vector<std::thread> threads_;  // those that the system gave
};

}  // namespace gs
