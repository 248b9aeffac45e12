// SPDX-License-Identifier: Apache-2.0
// For tests that provoke an error in a library that then leaks memory of its own. Including this
// header also suppresses reports of OpenImageIO's leaks in all threads.
#pragma once

#include "gs_core/system/sanitizers.h"

#ifdef GS_ADDRESS_SANITIZER
#include <sanitizer/lsan_interface.h>

extern "C" __attribute__((used, weak)) const char* __lsan_default_suppressions() {
  return "leak:libOpenImageIO\n";
}
#endif

namespace gs {

/// While it lives, LeakSanitizer ignores allocations of this thread. It does nothing in other
/// builds.
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
