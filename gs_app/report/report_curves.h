// SPDX-License-Identifier: Apache-2.0
// The curves of a report: metrics.csv and profile.csv as columns.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

namespace gs {

/// {"step": [...], "loss": [...], ...}: a list for each column of a metrics.csv, null where a cell is empty or no finite
/// number; empty lists where there is no file. Of more than `most` rows some are left out, evenly, but none that was
/// evaluated. A last row that a kill cut short is passed over. Throws Error where another is damaged.
nlohmann::ordered_json metrics_columns(const std::filesystem::path& metrics, std::size_t most);

/// Of a profile.csv, {"stages": {"step": [...], "names": [...], "milliseconds": [[...], ...]} (a list for each name),
/// "memory": {"step": [...], "host": [...], "gpu": [...]}}; either is left out where nothing is known. Errors as above.
nlohmann::ordered_json profile_columns(const std::filesystem::path& profile, std::size_t most);

}  // namespace gs
