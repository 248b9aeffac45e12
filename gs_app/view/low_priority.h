// SPDX-License-Identifier: Apache-2.0
// Threads that give way to those that train.
#pragma once

#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

namespace gs {

/// Gives the calling thread the lowest priority, the first time that it calls. Nothing where the system does not let it.
inline void lower_priority_once() {
  thread_local bool is_low = false;
  if (is_low) return;
  is_low = true;
  constexpr int kLowest = 19;
  setpriority(PRIO_PROCESS, id_t(syscall(SYS_gettid)), kLowest);
}

}  // namespace gs
