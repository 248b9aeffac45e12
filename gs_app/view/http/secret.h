// SPDX-License-Identifier: Apache-2.0
// Secrets in the addresses that a server prints.
#pragma once

#include <spdlog/fmt/fmt.h>

#include <cstdint>
#include <random>
#include <string>

namespace gs {

/// 32 hexadecimal digits that nobody can guess.
inline std::string new_secret() {
  std::random_device device;  // the system's, which is meant for secrets
  std::string secret;
  for (int i = 0; i < 4; ++i) secret += fmt::format("{:08x}", std::uint32_t(device()));
  return secret;
}

/// Takes the same time wherever the texts differ.
inline bool is_same_secret(const std::string& a, const std::string& b) {
  if (a.size() != b.size()) return false;
  unsigned char difference = 0;
  for (std::size_t i = 0; i < a.size(); ++i) difference |= static_cast<unsigned char>(a[i] ^ b[i]);
  return difference == 0;
}

}  // namespace gs
