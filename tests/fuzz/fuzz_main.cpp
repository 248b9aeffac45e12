// SPDX-License-Identifier: Apache-2.0
// From libFuzzer to the one target of the program.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>

#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/foreign_leaks.h"

namespace {

void drop_line(gs::detail::LogLevel, std::string_view) {}

}  // namespace

// Freed memory is kept for a while to find its use. Less of it makes the limit of memory a tight one.
extern "C" const char* __asan_default_options() {
  return "quarantine_size_mb=16:allocator_may_return_null=0:detect_stack_use_after_return=0";
}
extern "C" const char* __ubsan_default_options() { return "print_stacktrace=1"; }

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const bool is_quiet = (gs::detail::set_log_sink(drop_line), true);
  static_cast<void>(is_quiet);
  const gs::SerialLoops no_threads;  // scripts/fuzz.sh runs a target on each core
  gs::fuzz::targets().front().read({reinterpret_cast<const char*>(data), size});
  return 0;
}
