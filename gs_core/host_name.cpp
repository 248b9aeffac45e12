// SPDX-License-Identifier: Apache-2.0
#include "gs_core/host_name.h"

#include <unistd.h>

namespace gs {

std::string host_name() {
  char name[256] = {};
  return ::gethostname(name, sizeof name - 1) == 0 ? name : "";
}

}  // namespace gs
