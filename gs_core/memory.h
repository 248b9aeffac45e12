// SPDX-License-Identifier: Apache-2.0
// Where bytes live. A Buffer asks its Memory for room; that is all a container needs to know of a device.
#pragma once

#include <cstddef>

namespace gs {

/// One kind of memory: the host's, or a device's pool. Owned by its backend, outlives every Buffer in it.
class Memory {
 public:
  virtual ~Memory() = default;
  /// Room for `bytes` bytes, aligned to 128. Throws Error (out_of_memory) where there is none.
  virtual void* allocate(std::size_t bytes) = 0;
  virtual void deallocate(void* pointer, std::size_t bytes) noexcept = 0;
  /// Copies within this memory; the ranges do not overlap.
  virtual void copy(void* to, const void* from, std::size_t bytes) = 0;
  virtual void fill_zero(void* to, std::size_t bytes) = 0;
  /// Copies in from, and out to, host memory.
  virtual void upload(void* to, const void* from_host, std::size_t bytes) = 0;
  virtual void download(void* to_host, const void* from, std::size_t bytes) = 0;
  /// Bytes that may still be had, by and large: others take of it, too.
  virtual std::size_t free_bytes() const = 0;
};

/// The host's own memory.
Memory& host_memory();

/// For tests of what happens when memory runs out: asked before each allocation of any Memory, it may throw what
/// that would throw. One for the whole program; null, as at the start, allows everything.
using AllocationHook = void (*)(std::size_t bytes);
void set_allocation_hook(AllocationHook hook);
/// Each Memory calls it before it allocates.
void ask_allocation_hook(std::size_t bytes);

}  // namespace gs
