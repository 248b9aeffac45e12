// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/host_ram.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>

#include "gs_core/system/bytes.h"

namespace gs {

std::size_t host_ram_bytes() {
  std::size_t bytes =
      std::size_t(::sysconf(_SC_PHYS_PAGES)) * std::size_t(::sysconf(_SC_PAGE_SIZE));
  for (const char* limit :
       {"/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"}) {
    std::size_t most = 0;
    if (std::ifstream(limit) >> most && most > 0) bytes = std::min(bytes, most);  // not "max"
  }
  return bytes;
}

std::size_t photo_ram_bytes(double photo_ram_gib) {
  if (photo_ram_gib > 0) return std::size_t(photo_ram_gib * kBytesPerGib);
  return host_ram_bytes() / 2;
}

}  // namespace gs
