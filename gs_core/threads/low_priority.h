// SPDX-License-Identifier: Apache-2.0
// Low priority for threads that must not slow training down, such as those of the viewer's server.
#pragma once

#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

namespace gs {

/// Gives the calling thread the lowest priority. Only the first call of a thread does anything; it
/// has no effect if the system does not allow it.
inline void lower_priority_once() {
  thread_local bool is_low = false;
  if (is_low) return;
  is_low = true;
  constexpr int kLowest = 19;
  setpriority(PRIO_PROCESS, id_t(syscall(SYS_gettid)), kLowest);
}

}  // namespace gs
