// SPDX-License-Identifier: Apache-2.0
// Part of test programs that ask how much memory a reader asks for at once (damage.h).
#include <atomic>
#include <cstdlib>
#include <new>

#include "gs_core/system/sanitizers.h"

namespace gs {
extern std::atomic<std::size_t> largest_allocation;
std::atomic<std::size_t> largest_allocation{0};
}  // namespace gs

#ifdef GS_ADDRESS_SANITIZER
extern "C" const char* __asan_default_options();
const char* __asan_default_options() {
  return "max_allocation_size_mb=256:allocator_may_return_null=0";
}
#else
[[gnu::noinline]] void* operator new(std::size_t bytes) {
  std::size_t before = gs::largest_allocation;
  while (bytes > before && !gs::largest_allocation.compare_exchange_weak(before, bytes)) {
  }
  if (void* memory = std::malloc(bytes ? bytes : 1)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
#endif
