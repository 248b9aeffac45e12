// SPDX-License-Identifier: Apache-2.0
// A memory of its own for tests of models that lie in two.
#pragma once

#include <limits>

#include "gs_core/error.h"
#include "gs_core/memory.h"

namespace gs {

/// Host memory that counts what it has given, and says that so much is free.
class CountedMemory final : public Memory {
 public:
  void* allocate(std::size_t bytes) override {
    if (allocated + bytes > most)
      throw Error("the counted memory is full", ExitCode::out_of_memory);
    void* const pointer = host_memory().allocate(bytes);
    allocated += bytes;
    return pointer;
  }
  void deallocate(void* pointer, std::size_t bytes) noexcept override {
    host_memory().deallocate(pointer, bytes);
    allocated -= bytes;
  }
  void copy(void* to, const void* from, std::size_t bytes) override {
    host_memory().copy(to, from, bytes);
  }
  void fill_zero(void* to, std::size_t bytes) override { host_memory().fill_zero(to, bytes); }
  void upload(void* to, const void* from, std::size_t bytes) override { copy(to, from, bytes); }
  void download(void* to, const void* from, std::size_t bytes) override { copy(to, from, bytes); }
  std::size_t free_bytes() const override { return free; }

  std::size_t allocated = 0, free = std::size_t(1) << 40;
  std::size_t most = std::numeric_limits<std::size_t>::max();
};

}  // namespace gs
