// SPDX-License-Identifier: Apache-2.0
// Plain values in bytes that lie anywhere, lowest byte first.
#pragma once

#include <bit>
#include <cstring>
#include <string>

namespace gs {

static_assert(std::endian::native == std::endian::little);

template <class T>
T load_little(const void* from) {
  T value;
  std::memcpy(&value, from, sizeof value);
  return value;
}

template <class T>
void append_little(std::string& to, const T& value) {
  to.append(reinterpret_cast<const char*>(&value), sizeof value);
}

}  // namespace gs
