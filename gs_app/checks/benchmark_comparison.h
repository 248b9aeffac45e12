// SPDX-License-Identifier: Apache-2.0
// `gemsplat bench --against FILE`: the figures of this call beside those of earlier ones, or of
// other programs.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/system/text/json.h"

namespace gs {

/// What `bench -o` wrote, or a file of the same form about another program.
struct OtherReport {
  std::string name;  // of its column: the file's `program`, else its name without ending
  Json figures;
};

/// Reads such files. Throws Error where one is missing, is no JSON, or has neither a training step
/// nor a frame.
std::vector<OtherReport> read_reports(const std::vector<std::filesystem::path>& files);

/// One Markdown table: device, clock and model of each report, then milliseconds of a step and of
/// frames of each size, and memory, each with its ratio to the first report's. Below it stands what
/// the figures of each report include, and where they cannot be compared: other devices, other
/// numbers of Gaussians.
std::string comparison_text(const OtherReport& own, const std::vector<OtherReport>& others);

}  // namespace gs
