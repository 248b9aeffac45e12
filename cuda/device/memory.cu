// SPDX-License-Identifier: Apache-2.0
// Memory of the GPU, and that of the host which it uses in place. Both count the bytes allocated.
#include <atomic>
#include <cstring>

#include "cuda/backend.h"
#include "cuda/device/context.cuh"

namespace gs::cuda {
namespace {

std::atomic<std::size_t> allocated{0}, peak{0}, mapped{0};

[[noreturn]] void refuse_mapped(std::size_t bytes) {
  throw Error("the host has too little memory for another " + std::to_string(bytes >> 20) +
                  " MiB that the GPU can use in place (train.offload), beside the " +
                  std::to_string(mapped >> 20) + " MiB in use, with " +
                  std::to_string(host_memory().free_bytes() >> 20) +
                  " MiB free; lower the number of Gaussians (--max-gaussians) or the photos kept "
                  "decoded (--photo-ram), or raise the limit of locked memory (ulimit -l)",
              ExitCode::out_of_memory);
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
  check(cudaMemcpyAsync(to_host, from, bytes, cudaMemcpyDeviceToHost, context_.stream()),
        "a download");
  context_.synchronize();
}

std::size_t DeviceMemory::free_bytes() const {
  std::size_t free = 0, total = 0;
  check(cudaMemGetInfo(&free, &total), "asking for free memory");
  return free;
}

// Where the host has too little memory, the system would end the process instead of refusing.
void* MappedMemory::allocate(std::size_t bytes) {
  ask_allocation_hook(bytes);
  if (bytes > free_bytes()) refuse_mapped(bytes);
  void* pointer = nullptr;
  const cudaError_t error =
      cudaHostAlloc(&pointer, bytes, cudaHostAllocMapped | cudaHostAllocPortable);
  if (error == cudaErrorMemoryAllocation) {
    cudaGetLastError();  // the next call starts clean
    refuse_mapped(bytes);
  }
  check(error, "allocating memory of the host");
  mapped += bytes;
  return pointer;
}

void MappedMemory::deallocate(void* pointer, std::size_t bytes) noexcept {
  cudaStreamSynchronize(context_.stream());  // a kernel may still be using it
  cudaFreeHost(pointer);
  mapped -= bytes;
}

// The host copies, after all that the stream still does with either range.
void MappedMemory::copy(void* to, const void* from, std::size_t bytes) {
  context_.synchronize();
  std::memcpy(to, from, bytes);
}

void MappedMemory::fill_zero(void* to, std::size_t bytes) {
  check(cudaMemsetAsync(to, 0, bytes, context_.stream()), "a fill");
}

void MappedMemory::upload(void* to, const void* from_host, std::size_t bytes) {
  copy(to, from_host, bytes);
}

void MappedMemory::download(void* to_host, const void* from, std::size_t bytes) {
  copy(to_host, from, bytes);
}

Usage usage() { return {allocated, peak, mapped}; }

void restart_peak() { peak = allocated.load(); }

}  // namespace gs::cuda
