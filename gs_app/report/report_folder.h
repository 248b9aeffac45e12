// SPDX-License-Identifier: Apache-2.0
// The report of a folder, whatever it holds.
#pragma once

#include <filesystem>

#include "gs_core/system/text/json.h"

namespace gs {

/// Throws UsageError where `folder` is no folder.
void check_can_report(const std::filesystem::path& folder);

/// The data of the report of a run's or an experiment's folder. Throws UsageError where `folder` is
/// no folder; Error where it holds neither.
Json folder_report(const std::filesystem::path& folder);

/// Writes that report to `file`, and returns it. Throws Error also where this build carries no
/// report page.
std::filesystem::path write_folder_report(const std::filesystem::path& folder,
                                          const std::filesystem::path& file);

}  // namespace gs
