// SPDX-License-Identifier: Apache-2.0
#include "gs_core/memory.h"

#include <atomic>
#include <cstring>
#include <new>
#include <string>

#include "gs_core/error.h"

namespace gs {
namespace {

constexpr std::align_val_t kAlignment{128};

std::atomic<AllocationHook> allocation_hook = nullptr;

class HostMemory final : public Memory {
 public:
  void* allocate(std::size_t bytes) override {
    ask_allocation_hook(bytes);
    try {
      return ::operator new(bytes, kAlignment);
    } catch (const std::bad_alloc&) {
      throw Error("out of memory: " + std::to_string(bytes >> 20) +
                      " MiB more were asked for; lower the resolution (-r) or the number of "
                      "Gaussians (--max-gaussians)",
                  ExitCode::out_of_memory);
    }
  }
  void deallocate(void* pointer, std::size_t) noexcept override {
    ::operator delete(pointer, kAlignment);
  }
  void copy(void* to, const void* from, std::size_t bytes) override {
    std::memcpy(to, from, bytes);
  }
  void fill_zero(void* to, std::size_t bytes) override { std::memset(to, 0, bytes); }
  void upload(void* to, const void* from, std::size_t bytes) override { copy(to, from, bytes); }
  void download(void* to, const void* from, std::size_t bytes) override { copy(to, from, bytes); }
};

}  // namespace

Memory& host_memory() {
  static HostMemory memory;
  return memory;
}

void set_allocation_hook(AllocationHook hook) { allocation_hook = hook; }

void ask_allocation_hook(std::size_t bytes) {
  if (const AllocationHook hook = allocation_hook) hook(bytes);
}

}  // namespace gs
