// SPDX-License-Identifier: Apache-2.0
// Parses tables of settings in an experiment's file: into assignments as for --set, and grids into
// lists of configs.
#pragma once

#include <toml++/toml.h>

#include <filesystem>
#include <string>
#include <vector>

#include "gs_app/experiment/experiment_file.h"

namespace gs {

/// "file:line: "
std::string place_in(const std::filesystem::path& file, const toml::node& node);

/// Of one experiment. Ten lists of ten values would be ten billion.
inline constexpr std::size_t kMostRuns = 10'000;
/// Throws the UsageError for more; `place` is in front of the message.
[[noreturn]] void refuse_runs(const std::string& place);

/// A value on one line: a string without its quotes, any other value as TOML.
std::string value_text(const toml::node& node);

/// The text as a folder's name: characters other than letters, digits and "._+=-" become '_'.
std::string folder_name(std::string text);

/// {density = {every = 50}} or {"density.every" = 50} as "density.every=50", in the order of the
/// keys.
std::vector<PlacedSetting> flat_settings(const std::filesystem::path& file,
                                         const toml::table& table);

/// All combinations of the grid's lists, e.g. {density.every = [50, 100], ...}, as configs named
/// NAME+every=50+.... The last key changes fastest. Throws UsageError if a value is not a list, and for more
/// than kMostRuns configs.
std::vector<ExperimentConfig> unrolled(const std::filesystem::path& file,
                                       const ExperimentConfig& config, const toml::table& grid);

}  // namespace gs
