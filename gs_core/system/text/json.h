// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace gs {

/// Its keys stay in the order in which they were written.
using Json = nlohmann::ordered_json;
/// Its keys are sorted, and found fast where an object of a stranger's file has many.
using SortedJson = nlohmann::json;
/// Their numbers are floats, written with as few digits as tell one float from the next.
using FloatJson = nlohmann::basic_json<nlohmann::ordered_map, std::vector, std::string, bool,
                                       std::int64_t, std::uint64_t, float>;
using SortedFloatJson = nlohmann::basic_json<std::map, std::vector, std::string, bool, std::int64_t,
                                             std::uint64_t, float>;

/// The text of a file of ours. What is not UTF-8, as names of photos may be, becomes U+FFFD.
template <class J>
std::string file_text(const J& json) {
  return json.dump(2, ' ', false, J::error_handler_t::replace) + "\n";
}

}  // namespace gs
