// SPDX-License-Identifier: Apache-2.0
// One GPU and its compute stream. Every kernel of a backend is launched here, in order. Only
// synchronize() waits.
#pragma once

#include <cuda_runtime.h>

#include <string>
#include <utility>
#include <vector>

#include "gs_core/error.h"
#include "gs_core/memory.h"
#include "gs_render/stage_time.h"

namespace gs::cuda {

/// Throws Error where a CUDA call failed; `what` names the stage or the call.
void check(cudaError_t error, const char* what);

/// What never changes about a GPU.
struct Card {
  std::string name;
  int multiprocessors = 0;
  bool has_tensor_cores = false;  // that take fp16 and TF32 and sum in fp32: capability 8 and later
};

/// A GPU, its compute stream, and the times of its stages while profiling is on.
class Context {
 public:
  /// With a stream of its own.
  explicit Context(int device);
  /// On a stream that the caller owns, for a call. Costs nothing from the second one of a GPU on.
  Context(int device, cudaStream_t stream);
  ~Context();
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;

  int device() const { return device_; }
  cudaStream_t stream() const { return stream_; }
  const std::string& device_name() const { return card_.name; }
  int multiprocessors() const { return card_.multiprocessors; }
  bool has_tensor_cores() const { return card_.has_tensor_cores; }

  /// Waits until every launched kernel has run. A step of training never calls it.
  void synchronize();

  /// Launches a kernel of `blocks` blocks, and nothing for 0 blocks. An error names the stage.
  template <class... Parameters, class... Arguments>
  void launch(const char* stage, void (*kernel)(Parameters...), std::size_t blocks, int threads,
              Arguments&&... arguments) {
    if (blocks == 0) return;
    kernel<<<unsigned(blocks), unsigned(threads), 0, stream_>>>(
        std::forward<Arguments>(arguments)...);
    check(cudaGetLastError(), stage);
  }

  void set_profiling(bool on);
  /// Milliseconds of each stage since profiling was switched on, in the order of first use. Waits.
  std::vector<StageTime> stage_times();

 private:
  friend class StageScope;
  struct Lap {
    std::string stage;
    cudaEvent_t begin, end;
  };
  cudaEvent_t event();

  const int device_;
  const Card& card_;
  cudaStream_t stream_ = nullptr;
  const bool owns_stream_;
  bool profiling_ = false;
  std::vector<Lap> laps_;
  std::vector<cudaEvent_t> free_events_;
};

/// Makes a GPU the current one of this thread for a while: kernels are launched on that one alone.
class OnDevice {
 public:
  explicit OnDevice(int device) : device_(device) {
    check(cudaGetDevice(&before_), "asking for the current GPU");
    if (before_ != device_) check(cudaSetDevice(device_), "choosing the GPU");
  }
  ~OnDevice() {
    if (before_ != device_) cudaSetDevice(before_);
  }
  OnDevice(const OnDevice&) = delete;
  OnDevice& operator=(const OnDevice&) = delete;

 private:
  const int device_;
  int before_ = 0;
};

/// Marks the launches of one stage: named in profilers (NVTX), and timed while profiling is on.
class StageScope {
 public:
  StageScope(Context& context, const char* stage);
  ~StageScope();

 private:
  Context& context_;
  std::size_t lap_ = 0;
};

/// Memory of the context's GPU. Allocates with cudaMalloc, which is slow but rare: Buffers only
/// grow.
class DeviceMemory : public Memory {
 public:
  explicit DeviceMemory(Context& context) : context_(context) {}
  void* allocate(std::size_t bytes) override;
  void deallocate(void* pointer, std::size_t bytes) noexcept override;
  void copy(void* to, const void* from, std::size_t bytes) override;
  void fill_zero(void* to, std::size_t bytes) override;
  void upload(void* to, const void* from_host, std::size_t bytes) override;
  void download(void* to_host, const void* from, std::size_t bytes) override;
  std::size_t free_bytes() const override;

 private:
  Context& context_;
};

/// Blocks of `threads` that cover `count` items.
constexpr std::size_t blocks_for(std::size_t count, int threads) {
  return (count + std::size_t(threads) - 1) / std::size_t(threads);
}

}  // namespace gs::cuda
