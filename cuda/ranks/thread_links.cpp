// SPDX-License-Identifier: Apache-2.0
// Links between ranks that are threads: the receiver copies, once the sender's stream has come to
// the exchange, and the sender's stream waits for these copies.
#include <cuda_runtime_api.h>

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>

#include "cuda/ranks/device_link.h"
#include "gs_core/error.h"

namespace gs::cuda {
namespace {

void check_copy(cudaError_t error) {
  if (error != cudaSuccess)
    throw Error(std::string("ranks cannot copy from each other: ") + cudaGetErrorString(error));
}

// Where the threads meet. Each link owns it.
class Hub {
 public:
  explicit Hub(int count) : sent_(std::size_t(count)), ready_(sent_.size()), taken_(sent_.size()) {}
  ~Hub() {
    for (const cudaEvent_t event : ready_)
      if (event) cudaEventDestroy(event);
    for (const cudaEvent_t event : taken_)
      if (event) cudaEventDestroy(event);
  }

  // The events of a rank, on its GPU, which is the current one.
  void enter(int rank, const std::function<void()>& keep_watch) {
    for (cudaEvent_t* const event : {&ready_[std::size_t(rank)], &taken_[std::size_t(rank)]})
      check_copy(cudaEventCreateWithFlags(event, cudaEventDisableTiming));
    meet(keep_watch);
  }

  void exchange(int rank, const std::vector<DevicePiece>& sent,
                const std::vector<DevicePiece>& received, cudaStream_t stream,
                const std::function<void()>& keep_watch) {
    sent_[std::size_t(rank)] = sent;
    check_copy(cudaEventRecord(ready_[std::size_t(rank)], stream));
    meet(keep_watch);
    std::vector<std::size_t> pieces(sent_.size(), 0);  // received from each
    for (const DevicePiece& to : received) {
      const std::size_t sender = std::size_t(to.rank);
      const DevicePiece& from = piece_to(rank, sender, pieces[sender]++);
      GS_CHECK(from.bytes == to.bytes);
      check_copy(cudaStreamWaitEvent(stream, ready_[sender], 0));
      check_copy(cudaMemcpyAsync(to.data, from.data, to.bytes, cudaMemcpyDefault, stream));
    }
    check_copy(cudaEventRecord(taken_[std::size_t(rank)], stream));
    meet(keep_watch);
    for (const DevicePiece& piece : sent)
      check_copy(cudaStreamWaitEvent(stream, taken_[std::size_t(piece.rank)], 0));
  }

  void check() {
    const std::scoped_lock lock(mutex_);
    if (is_lost_) throw LinkLost{};
  }
  void give_up() {
    const std::scoped_lock lock(mutex_);
    is_lost_ = true;
    changed_.notify_all();
  }

 private:
  const DevicePiece& piece_to(int rank, std::size_t sender, std::size_t number) const {
    for (const DevicePiece& piece : sent_[sender])
      if (piece.rank == rank && number-- == 0) return piece;
    GS_CHECK(false);
    return sent_[sender].front();
  }

  // Returns when all ranks have come here.
  void meet(const std::function<void()>& keep_watch) {
    std::unique_lock lock(mutex_);
    const std::uint64_t round = round_;
    if (++arrived_ == sent_.size()) {
      arrived_ = 0;
      ++round_;
      changed_.notify_all();
    }
    const auto has_changed = [&] { return is_lost_ || round_ != round; };
    while (!changed_.wait_for(lock, std::chrono::milliseconds(20), has_changed)) {
      lock.unlock();
      keep_watch();
      lock.lock();
    }
    if (is_lost_) throw LinkLost{};
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::size_t arrived_ = 0;
  std::uint64_t round_ = 0;
  bool is_lost_ = false;
  // of each rank; others read them between two meetings
  std::vector<std::vector<DevicePiece>> sent_;
  std::vector<cudaEvent_t> ready_, taken_;
};

class ThreadLink final : public DeviceLink {
 public:
  ThreadLink(std::shared_ptr<Hub> hub, int rank, std::function<void()> keep_watch)
      : hub_(std::move(hub)), rank_(rank), keep_watch_(std::move(keep_watch)) {}
  void exchange(const std::vector<DevicePiece>& sent, const std::vector<DevicePiece>& received,
                CUstream_st* stream) override {
    hub_->exchange(rank_, sent, received, stream, keep_watch_);
  }
  void check() override { hub_->check(); }
  void give_up() noexcept override { hub_->give_up(); }

 private:
  const std::shared_ptr<Hub> hub_;
  const int rank_;
  const std::function<void()> keep_watch_;
};

class ThreadLinks final : public DeviceLinks {
 public:
  explicit ThreadLinks(std::shared_ptr<Hub> hub) : hub_(std::move(hub)) {}
  std::vector<std::byte> invitation() override { return {}; }
  std::unique_ptr<DeviceLink> connect(int device, int rank, int, const std::vector<std::byte>&,
                                      const std::function<void()>& keep_watch) override {
    check_copy(cudaSetDevice(device));
    hub_->enter(rank, keep_watch);
    return std::make_unique<ThreadLink>(hub_, rank, keep_watch);
  }

 private:
  const std::shared_ptr<Hub> hub_;
};

}  // namespace

std::vector<std::unique_ptr<DeviceLinks>> make_thread_links(int count) {
  const auto hub = std::make_shared<Hub>(count);
  std::vector<std::unique_ptr<DeviceLinks>> links;
  for (int rank = 0; rank < count; ++rank) links.push_back(std::make_unique<ThreadLinks>(hub));
  return links;
}

}  // namespace gs::cuda
