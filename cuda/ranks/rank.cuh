// SPDX-License-Identifier: Apache-2.0
// One of several GPUs that train a model together.
#pragma once

#include <vector>

#include "cuda/ranks/device_link.h"
#include "cuda/render/renderer.cuh"
#include "cuda/train/photo_rows.cuh"

namespace gs::cuda {

/// The streams of all ranks of this process. These write into each other's buffers, so the memory
/// of one may be given back only when all have done what was launched.
class RankStreams {
 public:
  void add(Context& context) { contexts_.push_back(&context); }
  void forget() { contexts_.clear(); }
  /// Waits for all of them. Throws Error where a kernel has failed.
  void synchronize() const {
    for (Context* const context : contexts_) context->synchronize();
  }
  /// Whether all have done what was launched.
  bool are_idle() const {
    bool are_idle = true;
    for (const Context* const context : contexts_)
      are_idle &= cudaStreamQuery(context->stream()) != cudaErrorNotReady;
    cudaGetLastError();  // "not ready" is no error of the next launch
    return are_idle;
  }
  /// The same where nobody can be told.
  void wait() const noexcept {
    for (const Context* const context : contexts_) cudaStreamSynchronize(context->stream());
  }

 private:
  std::vector<Context*> contexts_;
};

/// Memory of a rank's GPU, whichever GPU is the current one.
class RankMemory final : public DeviceMemory {
 public:
  RankMemory(Context& context, const RankStreams& all)
      : DeviceMemory(context), device_(context.device()), all_(all) {}
  void* allocate(std::size_t bytes) override {
    const OnDevice here(device_);
    return DeviceMemory::allocate(bytes);
  }
  void deallocate(void* pointer, std::size_t bytes) noexcept override {
    all_.wait();
    DeviceMemory::deallocate(pointer, bytes);
  }
  void fill_zero(void* to, std::size_t bytes) override {
    const OnDevice here(device_);
    DeviceMemory::fill_zero(to, bytes);
  }
  std::size_t free_bytes() const override {
    const OnDevice here(device_);
    return DeviceMemory::free_bytes();
  }

 private:
  const int device_;
  const RankStreams& all_;
};

/// A point in the work of a rank's stream for which the streams of others can wait.
class Mark {
 public:
  explicit Mark(const Context& context) : context_(context) {
    check(cudaEventCreateWithFlags(&event_, cudaEventDisableTiming), "making an event");
  }
  ~Mark() { cudaEventDestroy(event_); }
  Mark(const Mark&) = delete;
  Mark& operator=(const Mark&) = delete;
  /// What was launched so far comes before the mark.
  void set() { check(cudaEventRecord(event_, context_.stream()), "marking a stream"); }
  /// What is launched on `other` from now on comes after the mark, if it was ever set.
  void hold_back(const Context& other) const {
    check(cudaStreamWaitEvent(other.stream(), event_, 0), "waiting for a stream");
  }

 private:
  const Context& context_;
  cudaEvent_t event_ = nullptr;
};

/// Where the photos that one rank draws are projected to, with the rows of the whole model. All
/// ranks of a process write splats there, and read their gradients from there. Of ranks that are
/// other processes, each process has one that holds its own rows only.
struct PhotoRoom {
  PhotoRoom(Context& context, Memory& memory)
      : memory(memory), renderer(context, memory), pass(memory), photo_buffers(memory) {}
  void release_caches() {
    pass = RenderPass(memory);
    renderer.release_caches();
    photo_buffers.release();
  }
  void clear_gradients() {
    renderer.clear_gradients();
    photo_buffers.clear_gradients();
  }

  Memory& memory;
  CudaRenderer renderer;
  RenderPass pass;
  PhotoBuffers photo_buffers;
};

/// A rank: its GPU, its shard of the model, and what it draws photos with. Its GPU must be the
/// current one when it is made, and when anything is launched.
struct Rank {
  Rank(int device, RankStreams& streams)
      : context(device), memory(context, streams), photos(context, memory), room(context, memory),
        loss(make_loss(context, memory, photos)), shard(memory), dL_dimage(memory),
        has_projected(context), has_drawn(context), has_pulled_back(context) {
    streams.add(context);
  }
  std::uint32_t* halted() { return room.renderer.workspace().halted.data(); }
  void release_caches() {
    room.release_caches();
    dL_dimage.release();
  }

  Context context;
  RankMemory memory;
  PhotoStore photos;
  PhotoRoom room;  // of the photos that it draws
  std::unique_ptr<Loss> loss;
  TrainingModel shard;  // its rows of the model
  Shard place;          // which these are
  Buffer<float> dL_dimage;
  Mark has_projected, has_drawn, has_pulled_back;
};

/// Lets all these GPUs read and write each other's memory. Throws UsageError where two of them
/// cannot.
void connect(const std::vector<int>& devices);

/// Gives the shards of the ranks their rows of the model, which lies on one of the GPUs, and the
/// other way round. Both wait. Where memory runs out, deal_out() throws Error and the model has not
/// changed; merge() needs none.
void deal_out(const TrainingModel& model, const Deal& deal,
              std::vector<std::unique_ptr<Rank>>& ranks);
void merge(const std::vector<std::unique_ptr<Rank>>& ranks, const Deal& deal,
           const TrainingModel& model);

/// Gives the shard of rank `number` the arrays that the model has, with undefined rows.
void take_place(const TrainingModel& model, const Deal& deal, int number, Rank& rank);

/// The same where each rank is a process. All ranks call it; rank 0 has the model, and the others
/// give null. Shards have their places already.
void deal_to_processes(Rank& rank, const Deal& deal, int number, const TrainingModel* model,
                       DeviceLink& link);
void gather_from_processes(Rank& rank, const Deal& deal, int number, const TrainingModel* model,
                           DeviceLink& link);

}  // namespace gs::cuda
