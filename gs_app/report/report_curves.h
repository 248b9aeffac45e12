// SPDX-License-Identifier: Apache-2.0
// The training curves of a report: metrics.csv and profile.csv as JSON columns. To add a plot, see
// the steps at the top of apps/web/report/plots.js.
#pragma once

#include <filesystem>

#include "gs_core/system/text/json.h"

namespace gs {

/// {"step": [...], "loss": [...], ...}: a list for each column that the header of metrics.csv
/// names. An empty cell or a number that is not finite is null. Without a file there is only an
/// empty "step". Of a file with more than `most` rows only every n-th row is kept, and every row
/// with an evaluation. A last row that a kill has cut short is ignored. Throws Error if another row
/// is damaged, or if the header names a column twice.
Json metrics_columns(const std::filesystem::path& metrics, std::size_t most);

/// The contents of profile.csv: {"stages": {"step": [...], "names": [...], "milliseconds": [[...],
/// ...]}, "memory": {"step": [...], "host": [...], "gpu": [...]}}. "milliseconds" has a list for
/// each name. Either key is left out if the file has no such rows. Throws Error as above.
Json profile_columns(const std::filesystem::path& profile, std::size_t most);

}  // namespace gs
