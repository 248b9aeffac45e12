// SPDX-License-Identifier: Apache-2.0
#include "cuda/device/context.cuh"

#include <nvtx3/nvToolsExt.h>

#include <algorithm>
#include <map>
#include <mutex>

#include "cuda/device/unserved_card.h"

namespace gs::cuda {
namespace {

// Every file of the backend is compiled for the same GPUs, so this kernel stands for all of them.
__global__ void probe_kernel() {}

// What the build has for the current GPU. Throws Error where it has nothing that the GPU and its
// driver can run.
cudaFuncAttributes code_for(const cudaDeviceProp& properties) {
  cudaFuncAttributes code;
  const cudaError_t error = cudaFuncGetAttributes(&code, probe_kernel);
  if (error == cudaErrorNoKernelImageForDevice || error == cudaErrorUnsupportedPtxVersion ||
      error == cudaErrorJitCompilerNotFound) {
    cudaGetLastError();                                     // the next call starts clean
    std::vector<Capability> built_for{__CUDA_ARCH_LIST__};  // 900 is 9.0
    for (Capability& capability : built_for) capability /= 10;
    throw Error(unserved_card(properties.name, 10 * properties.major + properties.minor, built_for),
                ExitCode::bad_data);
  }
  check(error, "loading its kernels");
  return code;
}

Card read_card(int device) {
  cudaDeviceProp properties;
  check(cudaGetDeviceProperties(&properties, device), "asking for the GPU's properties");
  // PTX of an older GPU runs on a newer one, but has not the instructions of tensor cores.
  const cudaFuncAttributes code = code_for(properties);
  return {properties.name, properties.multiProcessorCount,
          properties.major >= 8 && code.ptxVersion >= 80};
}

// Of the current GPU, read once. Never freed: kernels may be launched while the process ends.
const Card& card_of(int device) {
  static auto& mutex = *new std::mutex;
  static auto& cards = *new std::map<int, Card>;
  const std::scoped_lock lock(mutex);
  const auto known = cards.find(device);
  return known != cards.end() ? known->second
                              : cards.emplace(device, read_card(device)).first->second;
}

const Card& chosen_card(int device) {
  check(cudaSetDevice(device), "choosing the GPU");
  return card_of(device);
}

}  // namespace

void check(cudaError_t error, const char* what) {
  if (error == cudaSuccess) return;
  const bool memory = error == cudaErrorMemoryAllocation;
  throw Error(
      std::string("the GPU failed in ") + what + ": " + cudaGetErrorString(error) +
          (memory ? "; lower the resolution (-r) or the number of Gaussians (--max-gaussians)"
                  : "; check nvidia-smi, or use --device cpu"),
      memory ? ExitCode::out_of_memory : ExitCode::bad_data);
}

Context::Context(int device) : device_(device), card_(chosen_card(device)), owns_stream_(true) {
  check(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "making a stream");
}

Context::Context(int device, cudaStream_t stream)
    : device_(device), card_(chosen_card(device)), stream_(stream), owns_stream_(false) {}

Context::~Context() {
  if (owns_stream_ || !laps_.empty()) cudaStreamSynchronize(stream_);
  for (const Lap& lap : laps_) {
    cudaEventDestroy(lap.begin);
    cudaEventDestroy(lap.end);
  }
  for (const cudaEvent_t event : free_events_) cudaEventDestroy(event);
  if (owns_stream_) cudaStreamDestroy(stream_);
}

void Context::synchronize() { check(cudaStreamSynchronize(stream_), "a kernel"); }

cudaEvent_t Context::event() {
  cudaEvent_t event;
  if (free_events_.empty()) {
    check(cudaEventCreate(&event), "making an event");
  } else {
    event = free_events_.back();
    free_events_.pop_back();
  }
  return event;
}

void Context::set_profiling(bool on) {
  profiling_ = on;
  if (!on) return;  // the laps are kept for stage_times(), and nothing waits
  synchronize();
  for (const Lap& lap : laps_) {
    free_events_.push_back(lap.begin);
    free_events_.push_back(lap.end);
  }
  laps_.clear();
}

std::vector<StageTime> Context::stage_times() {
  synchronize();
  std::vector<StageTime> times;
  for (const Lap& lap : laps_) {
    float milliseconds = 0;
    check(cudaEventElapsedTime(&milliseconds, lap.begin, lap.end), "reading an event");
    auto found = std::find_if(times.begin(), times.end(),
                              [&](const StageTime& time) { return time.stage == lap.stage; });
    if (found == times.end()) found = times.insert(times.end(), {lap.stage, {}});
    found->milliseconds.push_back(milliseconds);
  }
  return times;
}

StageScope::StageScope(Context& context, const char* stage) : context_(context) {
  nvtxRangePushA(stage);
  if (!context_.profiling_) return;
  lap_ = context_.laps_.size();
  context_.laps_.push_back({stage, context_.event(), context_.event()});
  cudaEventRecord(context_.laps_[lap_].begin, context_.stream_);
}

StageScope::~StageScope() {
  if (context_.profiling_) cudaEventRecord(context_.laps_[lap_].end, context_.stream_);
  nvtxRangePop();
}

}  // namespace gs::cuda
