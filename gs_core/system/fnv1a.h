// SPDX-License-Identifier: Apache-2.0
// A hash for names and files that is written down, in results.json (scene_hash) and
// reconstruct.json, and that processes of one run compare. Its values must never change. For checksums of much data, checked_file.h has
// XXH3.
#pragma once

#include <cstdint>
#include <string_view>

namespace gs {

/// FNV-1a of 64 bits (Fowler, Noll, Vo): each byte is added by xor, then a multiplication spreads
/// all bits.
class Fnv1a {
 public:
  void add(std::string_view bytes) {
    for (const char byte : bytes) value_ = (value_ ^ static_cast<unsigned char>(byte)) * kPrime;
  }
  std::uint64_t value() const { return value_; }

 private:
  static constexpr std::uint64_t kStart = 0xcbf29ce484222325, kPrime = 0x100000001b3;
  std::uint64_t value_ = kStart;
};

}  // namespace gs
