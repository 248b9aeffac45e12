// SPDX-License-Identifier: Apache-2.0
// Device memory that the caller of the operator provides, for the Buffers of one call.
#pragma once

#include "cuda/device/context.cuh"
#include "gs_render/operator.h"

namespace gs::cuda {

/// Takes large pieces from the caller, and cuts Buffers from them one after the other. The pieces
/// are the caller's, who frees them.
class CallerMemory final : public DeviceMemory {
 public:
  CallerMemory(Context& context, AllocateOnDevice allocate)
      : DeviceMemory(context), allocate_(std::move(allocate)) {}

  /// The next piece has at least so many bytes, where the last one has fewer left.
  void expect(std::size_t bytes) { expected_ = bytes; }
  /// No Buffer grows from here on.
  void close() { allocate_ = nullptr; }

  void* allocate(std::size_t bytes) override;
  /// The latest Buffer gives its bytes back to its piece. The others leave a gap until the call ends.
  void deallocate(void* pointer, std::size_t bytes) noexcept override;

 private:
  AllocateOnDevice allocate_;
  std::size_t expected_ = 0;
  std::byte *next_ = nullptr, *end_ = nullptr;  // what is left of the last piece
};

}  // namespace gs::cuda
