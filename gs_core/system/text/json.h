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

}  // namespace gs
