// SPDX-License-Identifier: Apache-2.0
// Tables of settings in an experiment's file: flat, as --set takes them, and grids as lists of configs.
#pragma once

#include <toml++/toml.h>

#include <filesystem>
#include <string>
#include <vector>

#include "gs_app/experiment/experiment_file.h"

namespace gs {

/// "file:line: "
std::string place_in(const std::filesystem::path& file, const toml::node& node);

/// A value on one line: text without its quotes, anything else as TOML.
std::string value_text(const toml::node& node);

/// What a folder can be called: letters, digits and "._+=-"; others become '_'.
std::string folder_name(std::string text);

/// {density = {every = 50}} or {"density.every" = 50} as "density.every=50", in the order of the keys.
std::vector<PlacedSetting> flat_settings(const std::filesystem::path& file,
                                         const toml::table& table);

/// The config at each point of a grid of lists {density.every = [50, 100], ...}: all combinations, the last key
/// fastest; named NAME+every=50+.... Throws UsageError where a value is no list.
std::vector<ExperimentConfig> unrolled(const std::filesystem::path& file,
                                       const ExperimentConfig& config, const toml::table& grid);

}  // namespace gs
