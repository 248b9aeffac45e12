// SPDX-License-Identifier: Apache-2.0
// What GCC 12's static runtime asks of the C library, and versions before 2.36 lack: release.sh
// --sysroot links it into archive and wheel.
#include <dlfcn.h>
#include <link.h>
#include <sys/random.h>

#include <cstdint>
#include <cstdlib>

namespace {

/// The loaded file that holds an address: its range, and the header of its tables for unwinding.
struct Search {
  std::uintptr_t address;
  dl_find_object* found;
};

int look_into(dl_phdr_info* file, std::size_t, void* context) {
  Search& search = *static_cast<Search*>(context);
  bool holds_address = false;
  std::uintptr_t begin = UINTPTR_MAX, end = 0;
  void* tables = nullptr;
  for (int i = 0; i < file->dlpi_phnum; ++i) {
    const ElfW(Phdr)& part = file->dlpi_phdr[i];
    const std::uintptr_t start = file->dlpi_addr + part.p_vaddr;
    if (part.p_type == PT_GNU_EH_FRAME) tables = reinterpret_cast<void*>(start);
    if (part.p_type != PT_LOAD) continue;
    begin = start < begin ? start : begin;
    end = start + part.p_memsz > end ? start + part.p_memsz : end;
    if (search.address >= start && search.address < start + part.p_memsz) holds_address = true;
  }
  if (!holds_address || !tables) return 0;
  search.found->dlfo_flags = 0;
  search.found->dlfo_map_start = reinterpret_cast<void*>(begin);
  search.found->dlfo_map_end = reinterpret_cast<void*>(end);
  search.found->dlfo_link_map = nullptr;
  search.found->dlfo_eh_frame = tables;
  return 1;
}

}  // namespace

#define GS_HIDDEN __attribute__((visibility("hidden")))

extern "C" {

/// glibc 2.32. Zero is always right: counters of shared pointers are then atomic.
GS_HIDDEN char __libc_single_threaded = 0;

/// glibc 2.35: where exceptions find the tables of a function.
GS_HIDDEN int _dl_find_object(void* address, dl_find_object* result) noexcept {
  Search search{reinterpret_cast<std::uintptr_t>(address), result};
  return dl_iterate_phdr(look_into, &search) ? 0 : -1;
}

/// glibc 2.36: one of the sources of std::random_device.
GS_HIDDEN std::uint32_t arc4random() noexcept {
  std::uint32_t value = 0;
  if (getrandom(&value, sizeof value, 0) != sizeof value) std::abort();
  return value;
}
}
