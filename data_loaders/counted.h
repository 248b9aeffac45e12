// SPDX-License-Identifier: Apache-2.0
// Counts in messages, with the noun and the verb in the right number.
#pragma once

#include <cstddef>
#include <string>

namespace gs {

/// "1 photo", "3 photos".
inline std::string counted(std::size_t count, const std::string& noun) {
  return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

/// "1 photo is", "3 photos are": with the verb for one and for several.
inline std::string counted(std::size_t count, const std::string& noun, const char* one,
                           const char* more) {
  return counted(count, noun) + " " + (count == 1 ? one : more);
}

}  // namespace gs
