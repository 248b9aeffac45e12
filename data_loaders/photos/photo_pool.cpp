// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/photo_pool.h"

#include <algorithm>

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_core/threads/start_threads.h"

namespace gs {
namespace {

constexpr std::size_t kNone = std::size_t(-1);

}  // namespace

PhotoPool::PhotoPool(std::vector<PhotoCost> costs, Decode decode, std::size_t budget_bytes,
                     int threads)
    : costs_(std::move(costs)), decode_(std::move(decode)), budget_bytes_(budget_bytes),
      thread_count_(std::max(threads, 1)), entries_(costs_.size()) {
  GS_CHECK(budget_bytes_ >= least_budget(costs_));
}

PhotoPool::~PhotoPool() {
  {
    const std::lock_guard lock(mutex_);
    quit_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

std::size_t PhotoPool::least_budget(const std::vector<PhotoCost>& costs) {
  std::size_t held = 0, decoding = 0;
  for (const PhotoCost& cost : costs) {
    held = std::max(held, cost.held);
    decoding = std::max({decoding, cost.decoding, cost.held});
  }
  return held + decoding;
}

PhotoPool::Counts PhotoPool::counts() const {
  const std::lock_guard lock(mutex_);
  return {live_bytes_, peak_bytes_, decoded_};
}

void PhotoPool::prefetch_decode(std::size_t index) {
  const std::lock_guard lock(mutex_);
  Entry& entry = entries_.at(index);
  entry.expected = ++calls_;
  ++entry.expectations;
  entry.released = false;
  expected_.push_back(index);
  if (!has_started_) start_threads(threads_, thread_count_, [this] { serve(); });
  has_started_ = true;  // if none did, view() decodes
  changed_.notify_all();
}

void PhotoPool::release(std::size_t index) {
  const std::lock_guard lock(mutex_);
  entries_.at(index).released = true;
  changed_.notify_all();
}

std::shared_ptr<const View> PhotoPool::view(std::size_t index) {
  std::unique_lock lock(mutex_);
  Entry& entry = entries_.at(index);
  fulfill(index);
  struct Waiting {  // keeps the decoded photo until this call returns it
    int& count;
    explicit Waiting(int& count) : count(++count) {}
    ~Waiting() { --count; }
  } const waiting(entry.waiting);
  while (entry.state != State::present) {
    const bool fits = entry.state == State::absent && free_bytes_for(costs_[index].decoding, true);
    // If nothing is being decoded, only the caller's own photos take the memory: exceed the budget.
    if (fits || (entry.state == State::absent && decoding_ == 0))
      decode(index, lock);
    else
      changed_.wait(lock);
  }
  entry.asked = ++calls_;
  entry.released = false;
  std::shared_ptr<const View> result = entry.view;  // in use from here on
  free_bytes_for(0, true);                          // if photos in use have exceeded the budget
  changed_.notify_all();
  return result;
}

void PhotoPool::fulfill(std::size_t index) {
  const auto at = std::find(expected_.begin(), expected_.end(), index);
  if (at == expected_.end()) return;
  expected_.erase(at);
  --entries_[index].expectations;
}

// A thread decodes the next prefetched photo, if it fits without dropping other prefetched ones.
void PhotoPool::serve() {
  const SerialLoops beside_the_pool;
  std::unique_lock lock(mutex_);
  while (!quit_) {
    const std::size_t index = next_expected();
    if (index == kNone || !free_bytes_for(costs_[index].decoding, false)) {
      changed_.wait(lock);
      continue;
    }
    try {
      decode(index, lock);
    } catch (...) {  // reported when the photo is asked for
      entries_[index].has_failed = true;
    }
  }
}

std::size_t PhotoPool::next_expected() const {
  for (const std::size_t index : expected_)
    if (entries_[index].state == State::absent && !entries_[index].has_failed) return index;
  return kNone;
}

// Unlocks while the photo is being decoded.
void PhotoPool::decode(std::size_t index, std::unique_lock<std::mutex>& lock) {
  Entry& entry = entries_[index];
  const PhotoCost& cost = costs_[index];
  reserve(cost.decoding);
  entry.state = State::decoding;
  ++decoding_;
  lock.unlock();
  std::shared_ptr<const View> view;
  std::exception_ptr failure;
  try {
    view = std::make_shared<const View>(decode_(index));
  } catch (...) {
    failure = std::current_exception();
  }
  lock.lock();
  --decoding_;
  live_bytes_ -= cost.decoding;
  changed_.notify_all();
  entry.state = failure ? State::absent : State::present;
  if (failure) std::rethrow_exception(failure);
  reserve(cost.held);
  entry.view = std::move(view);
  entry.has_failed = false;
  ++decoded_;
}

void PhotoPool::reserve(std::size_t bytes) {
  live_bytes_ += bytes;
  peak_bytes_ = std::max(peak_bytes_, live_bytes_);
}

bool PhotoPool::free_bytes_for(std::size_t bytes, bool at_any_cost) {
  while (live_bytes_ + bytes > budget_bytes_) {
    const std::size_t index = first_to_drop(at_any_cost);
    if (index == kNone) return false;
    entries_[index].view.reset();
    entries_[index].state = State::absent;
    live_bytes_ -= costs_[index].held;
  }
  return true;
}

std::size_t PhotoPool::first_to_drop(bool at_any_cost) const {
  const auto rank = [&](const Entry& entry) {
    const int kind = entry.expectations ? 0 : entry.released ? 2 : 1;
    return std::pair(kind, entry.expectations ? entry.expected : entry.asked);
  };
  std::size_t first = kNone;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    const Entry& entry = entries_[i];
    if (entry.state != State::present || entry.waiting || entry.view.use_count() > 1) continue;
    if (entry.expectations && !at_any_cost) continue;
    if (first == kNone || rank(entry) > rank(entries_[first])) first = i;
  }
  return first;
}

}  // namespace gs
