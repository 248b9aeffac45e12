// SPDX-License-Identifier: Apache-2.0
// For tests that drive a library into an error in which it loses memory of its own. Includes of this file overlook what
// OpenImageIO loses in whatever thread.
#pragma once

#include "tests/support/sanitizers.h"

#ifdef GS_ADDRESS_SANITIZER
#include <sanitizer/lsan_interface.h>

extern "C" __attribute__((used, weak)) const char* __lsan_default_suppressions() {
  return "leak:libOpenImageIO\n";
}
#endif

namespace gs {

/// While it lives, LeakSanitizer overlooks what this thread allocates; nothing in other builds.
class IgnoreForeignLeaks {
 public:
  IgnoreForeignLeaks() = default;
  IgnoreForeignLeaks(const IgnoreForeignLeaks&) = delete;
  ~IgnoreForeignLeaks() {}

#ifdef GS_ADDRESS_SANITIZER
 private:
  __lsan::ScopedDisabler disabler_;
#endif
};

}  // namespace gs
