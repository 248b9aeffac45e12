// SPDX-License-Identifier: Apache-2.0
// A config as TOML text with a line for each setting: `train.seed = 42`. Checkpoints have it.
#pragma once

#include <string>

#include "gs_core/config/config.h"

namespace gs {

std::string setting_lines(const Config& config);
/// Reads it over the defaults (config.cpp, as files are read). Throws UsageError for a setting that
/// this version does not have.
Config config_of_lines(const std::string& text);

}  // namespace gs
