// SPDX-License-Identifier: Apache-2.0
#include "cuda/operator/caller_memory.cuh"

#include <algorithm>

namespace gs::cuda {
namespace {

constexpr std::size_t kAlignment = 256;  // bytes, as cudaMalloc has it

std::size_t aligned(std::size_t bytes) {
  return (bytes + kAlignment - 1) / kAlignment * kAlignment;
}

}  // namespace

void* CallerMemory::allocate(std::size_t bytes) {
  ask_allocation_hook(bytes);
  const std::size_t size = aligned(bytes);
  if (std::size_t(end_ - next_) < size) {
    const std::size_t piece = std::max(size, aligned(expected_));
    GS_CHECK(allocate_ != nullptr);
    next_ = static_cast<std::byte*>(allocate_(piece));
    end_ = next_ + piece;
    expected_ = 0;
  }
  void* const result = next_;
  next_ += size;
  return result;
}

void CallerMemory::deallocate(void* pointer, std::size_t bytes) noexcept {
  if (static_cast<std::byte*>(pointer) + aligned(bytes) == next_)
    next_ = static_cast<std::byte*>(pointer);
}

}  // namespace gs::cuda
