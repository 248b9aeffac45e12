// SPDX-License-Identifier: Apache-2.0
// Memory of the GPU. It counts the bytes allocated.
#include <atomic>

#include "cuda/backend.h"
#include "cuda/device/context.cuh"
#include "gs_core/threads/parallel.h"

namespace gs::cuda {
namespace {

std::atomic<std::size_t> allocated{0}, peak{0};

// The system gives new memory its pages when they are first written. All threads get them much sooner
// than the one that copies, which waits for them three times as long as for the bytes. What the
// memory holds is lost.
void take_pages(void* host, std::size_t bytes) {
  constexpr std::size_t kPage = 4096, kPagesAtATime = 512, kLeastBytes = 16 << 20;
  if (bytes < kLeastBytes) return;
  volatile char* const first = static_cast<char*>(host);
  parallel_for((bytes - 1) / kPage + 1, kPagesAtATime,
               [&](std::size_t i) { first[i * kPage] = 0; });
}

}  // namespace

void* DeviceMemory::allocate(std::size_t bytes) {
  ask_allocation_hook(bytes);
  void* pointer = nullptr;
  const cudaError_t error = cudaMalloc(&pointer, bytes);
  if (error == cudaErrorMemoryAllocation) {
    cudaGetLastError();  // the next call starts clean
    throw Error("the GPU has too little free memory for another " + std::to_string(bytes >> 20) +
                    " MiB beside the " + std::to_string(allocated >> 20) +
                    " MiB in use; lower the resolution (-r), the number of Gaussians "
                    "(--max-gaussians) or the photos kept on the GPU (train.photo_gib)",
                ExitCode::out_of_memory);
  }
  check(error, "allocating memory");
  const std::size_t now = allocated += bytes;
  for (std::size_t seen = peak; seen < now && !peak.compare_exchange_weak(seen, now);) {
  }
  return pointer;
}

void DeviceMemory::deallocate(void* pointer, std::size_t bytes) noexcept {
  cudaStreamSynchronize(context_.stream());  // a kernel may still be using it
  cudaFree(pointer);
  allocated -= bytes;
}

void DeviceMemory::copy(void* to, const void* from, std::size_t bytes) {
  check(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDeviceToDevice, context_.stream()), "a copy");
}

void DeviceMemory::fill_zero(void* to, std::size_t bytes) {
  check(cudaMemsetAsync(to, 0, bytes, context_.stream()), "a fill");
}

void DeviceMemory::upload(void* to, const void* from_host, std::size_t bytes) {
  check(cudaMemcpyAsync(to, from_host, bytes, cudaMemcpyHostToDevice, context_.stream()),
        "an upload");
  context_.synchronize();
}

void DeviceMemory::download(void* to_host, const void* from, std::size_t bytes) {
  take_pages(to_host, bytes);
  check(cudaMemcpyAsync(to_host, from, bytes, cudaMemcpyDeviceToHost, context_.stream()),
        "a download");
  context_.synchronize();
}

std::size_t DeviceMemory::free_bytes() const {
  std::size_t free = 0, total = 0;
  check(cudaMemGetInfo(&free, &total), "asking for free memory");
  return free;
}

Usage usage() { return {allocated, peak}; }

void restart_peak() { peak = allocated.load(); }

}  // namespace gs::cuda
