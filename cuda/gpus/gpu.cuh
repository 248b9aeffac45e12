// SPDX-License-Identifier: Apache-2.0
// The GPUs of a backend. With several, each has a shard of the model, and kernels of one write into
// the buffers of another.
#pragma once

#include <memory>
#include <vector>

#include "cuda/gpus/shard.h"
#include "cuda/photo_terms/depth.cuh"
#include "cuda/photo_terms/surface.cuh"
#include "cuda/photo_terms/view_maps.cuh"
#include "cuda/render/renderer.cuh"
#include "cuda/step/photo_rows.cuh"
#include "gs_train/training_model.h"

namespace gs::cuda {

/// The streams of all GPUs of a backend. These write into each other's buffers, so the memory of
/// one may be given back only when all have done what was launched.
class Streams {
 public:
  void add(Context& context) { contexts_.push_back(&context); }
  void forget() { contexts_.clear(); }
  /// Waits for all of them. Throws Error where a kernel has failed.
  void synchronize() const {
    for (Context* const context : contexts_) context->synchronize();
  }
  /// Waits for all of them where nobody can be told of an error.
  void wait() const noexcept {
    for (const Context* const context : contexts_) cudaStreamSynchronize(context->stream());
  }

 private:
  std::vector<Context*> contexts_;
};

/// Memory of one of a backend's GPUs, whichever GPU is the current one.
class GpuMemory final : public DeviceMemory {
 public:
  GpuMemory(Context& context, const Streams& all)
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
  const Streams& all_;
};

/// A loss that a backend has.
struct LossRow {
  const char* name;  // a word of loss.kind
  std::unique_ptr<Loss> (*make)(Context&, Memory&, PhotoStore&);
};

/// One GPU: what it draws photos with, and the rows of the model that it trains. It must be the
/// current one when anything is launched on it.
struct Gpu {
  Gpu(int device, Streams& streams);
  ~Gpu();
  Gpu(const Gpu&) = delete;
  Gpu& operator=(const Gpu&) = delete;

  int device() const { return context.device(); }
  std::uint32_t* halted() { return renderer.workspace().halted.data(); }
  void use(const LossRow& row) { loss = row.make(context, memory, photos); }
  /// Sums and gradients are zero again, after a step that failed.
  void clear_gradients();
  /// Between steps: releases what the next one makes anew, except what row operations borrow.
  void release_step();
  /// Between steps: releases what the next one makes anew.
  void release_caches();

  Context context;
  GpuMemory memory;
  PhotoStore photos;
  CudaRenderer renderer;
  RenderPass pass;
  PhotoBuffers photo_buffers;  // of the photos that it draws, with the rows of the whole model
  std::unique_ptr<Loss> loss;
  Buffer<float> dL_dimage;
  ViewMaps<float> depth_maps;
  ViewMaps<std::uint8_t> normal_maps;
  DepthStage depth;
  SurfaceStage surface;
  // The shard of one of several GPUs. A GPU that is alone trains the model itself, and these are
  // empty.
  TrainingModel shard;
  Shard place;
  cudaEvent_t launched = nullptr;  // of meet()
};

/// One or more GPUs of this process.
class Gpus {
 public:
  /// They can read and write each other's memory afterwards, and the first one is the current one.
  /// A GPU that is named twice counts as two, for tests. Throws UsageError where two of them
  /// cannot reach each other's memory.
  explicit Gpus(const std::vector<int>& devices);
  ~Gpus();
  Gpus(const Gpus&) = delete;
  Gpus& operator=(const Gpus&) = delete;

  std::size_t count() const { return all_.size(); }
  bool are_several() const { return all_.size() > 1; }
  Gpu& first() { return *all_.front(); }
  const Gpu& first() const { return *all_.front(); }
  Gpu& operator[](std::size_t i) { return *all_[i]; }
  const Streams& streams() const { return streams_; }
  /// Calls f(gpu) for each, which is the current one meanwhile.
  template <class F>
  void for_each(F&& f) {
    for (const std::unique_ptr<Gpu>& gpu : all_) {
      const OnDevice here(gpu->device());
      f(*gpu);
    }
  }
  /// What is launched on any of them from now on comes after all that was launched so far.
  void meet();

  /// Gives the shards their rows of the model, which lies on the first GPU, in chunks of 2^k rows.
  /// Waits. Where memory runs out it throws Error, and the model has not changed.
  void deal_out(const TrainingModel& model, std::size_t chunk_rows);
  /// Puts the rows of the shards back into the model, which has room for them. Waits.
  void merge(const TrainingModel& model);

 private:
  Streams streams_;
  std::vector<std::unique_ptr<Gpu>> all_;
};

}  // namespace gs::cuda
