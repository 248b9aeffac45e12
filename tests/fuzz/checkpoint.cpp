// SPDX-License-Identifier: Apache-2.0
// Checkpoints. The target makes the checksum right, so that a forged file is read to its end.
#include "gs_app/checkpoints/checkpoint_file.h"

#include <cstring>

#include "gs_core/system/files/checked_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

/// The section "end": its name, its size, and the hash of all before it.
constexpr std::size_t kHashBytes = 8, kEndBytes = 32 + 8 + kHashBytes;

void read(std::string_view bytes) {
  std::string forged(bytes);
  if (forged.size() >= kEndBytes) {
    RunningHash hash;
    hash.add(forged.data(), forged.size() - kEndBytes);
    const std::uint64_t value = hash.value();
    std::memcpy(forged.data() + forged.size() - kHashBytes, &value, kHashBytes);
  }
  takes([&] { read_checkpoint(file_of("step_7.ckpt", forged)); });
}

const Registered registered{"checkpoint", read};

}  // namespace
}  // namespace gs::fuzz
