// SPDX-License-Identifier: Apache-2.0
// The settings as people read them: docs/reference/settings.md, and the texts of `gemsplat config
// explain` and `diff`.
#pragma once

#include <string>

#include "gs_core/config/config.h"

namespace gs {

/// docs/reference/settings.md: every setting in tables, and the presets. A test holds the file
/// against it.
std::string config_markdown();

/// Value, origin, meaning, unit, range, default and source of the settings that `wanted` names: a
/// key, a section, or all if it is empty. Throws UsageError, which names the nearest key, if there
/// is no such setting.
std::string explain(const Config& config, const SettingOrigins& origins, const std::string& wanted);

/// A line "key = A -> B  (origin of A -> origin of B)" for each setting that differs; empty if none
/// does.
std::string difference(const Config& a, const SettingOrigins& a_origins, const Config& b,
                       const SettingOrigins& b_origins);

}  // namespace gs
