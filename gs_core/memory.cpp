// SPDX-License-Identifier: Apache-2.0
#include "gs_core/memory.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <fstream>
#include <limits>
#include <new>
#include <string>

#include "gs_core/error.h"

namespace gs {
namespace {

constexpr std::align_val_t kAlignment{128};
constexpr std::size_t kAnyAmount = std::numeric_limits<std::size_t>::max();

// Bytes that the kernel can give without swapping.
std::size_t available_ram() {
  std::ifstream file("/proc/meminfo");
  std::string name, unit;
  std::size_t kib = 0;
  while (file >> name >> kib && std::getline(file, unit))
    if (name == "MemAvailable:") return kib << 10;
  return std::size_t(::sysconf(_SC_AVPHYS_PAGES)) * std::size_t(::sysconf(_SC_PAGE_SIZE));
}

// Bytes left below the limit of a container or a batch job. Its file cache counts as used.
std::size_t left_to_control_group() {
  std::size_t most = 0, taken = 0;
  const char* const folder = "/sys/fs/cgroup/";
  if (!(std::ifstream(std::string(folder) + "memory.max") >> most)) return kAnyAmount;  // "max"
  if (!(std::ifstream(std::string(folder) + "memory.current") >> taken)) return kAnyAmount;
  return most > taken ? most - taken : 0;
}

std::atomic<AllocationHook> allocation_hook = nullptr;

class HostMemory final : public Memory {
 public:
  void* allocate(std::size_t bytes) override {
    ask_allocation_hook(bytes);
    try {
      return ::operator new(bytes, kAlignment);
    } catch (const std::bad_alloc&) {
      throw Error("out of memory: " + std::to_string(bytes >> 20) + " MiB more were asked for",
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
  std::size_t free_bytes() const override {
    return std::min(available_ram(), left_to_control_group());
  }
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
