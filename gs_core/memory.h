// SPDX-License-Identifier: Apache-2.0
// Where bytes live: on the host, or on a device. A Buffer needs nothing else of a device than its
// Memory.
#pragma once

#include <cstddef>

namespace gs {

/// One kind of memory: the host's, or a device's pool. Its backend owns it, and it outlives every
/// Buffer in it.
class Memory {
 public:
  virtual ~Memory() = default;
  /// `bytes` bytes, aligned to 128. Throws Error (out_of_memory) if there is not enough memory.
  virtual void* allocate(std::size_t bytes) = 0;
  virtual void deallocate(void* pointer, std::size_t bytes) noexcept = 0;
  /// Copies within this memory; the ranges do not overlap.
  virtual void copy(void* to, const void* from, std::size_t bytes) = 0;
  virtual void fill_zero(void* to, std::size_t bytes) = 0;
  /// Copies in from, and out to, host memory.
  virtual void upload(void* to, const void* from_host, std::size_t bytes) = 0;
  virtual void download(void* to_host, const void* from, std::size_t bytes) = 0;
  /// About how many bytes are still free. Other programs use the same memory, so it may be less a
  /// moment later.
  virtual std::size_t free_bytes() const = 0;
};

/// The host's own memory.
Memory& host_memory();

/// A hook for tests that let memory run out. It is called before each allocation of any Memory and
/// may throw as the allocation would. There is one for the whole program; null, the initial value,
/// allows everything.
using AllocationHook = void (*)(std::size_t bytes);
void set_allocation_hook(AllocationHook hook);
/// Calls the hook. Each Memory does so before it allocates.
void ask_allocation_hook(std::size_t bytes);

}  // namespace gs
