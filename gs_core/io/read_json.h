// SPDX-License-Identifier: Apache-2.0
// JSON files beside models, in runs and experiments.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

namespace gs {

/// A JSON file of a run or an experiment. Throws Error if it cannot be read or is not an object.
nlohmann::ordered_json read_json(const std::filesystem::path& file);

}  // namespace gs
