// SPDX-License-Identifier: Apache-2.0
// The settings as people read them: docs/configuration.md, and what `gemsplat config explain` says of one.
#pragma once

#include <string>

#include "gs_core/config/config.h"

namespace gs {

/// docs/configuration.md: every setting in tables, and the presets. A test holds the file against it.
std::string config_markdown();

/// All there is to say of the settings that `wanted` names (a key, a section, or empty: all): value, origin, meaning, unit,
/// range, default, source. Throws UsageError that names the nearest key where there is none.
std::string explain(const Config& config, const SettingOrigins& origins, const std::string& wanted);

/// A line "key = A -> B  (origin of A -> origin of B)" for each setting that differs; empty where none does.
std::string difference(const Config& a, const SettingOrigins& a_origins, const Config& b,
                       const SettingOrigins& b_origins);

}  // namespace gs
