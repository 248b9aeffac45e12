// SPDX-License-Identifier: Apache-2.0
// Which settings differ between two configs, and whether that matters. Resuming, experiments,
// reports, tables and `gemsplat config diff` all ask here.
#pragma once

#include <string>
#include <vector>

#include "gs_core/config/config.h"
#include "gs_core/config/config_fields.h"

namespace gs {

/// One setting that has another value in b than in a.
struct SettingChange {
  std::string key;   // "section.name"
  std::string a, b;  // the values as TOML text: "white" in quotes, 0.25, [7000, 30000]
  OnChange on_change;

  /// Whether runs of a and b give different results. False for, say, train.log_every.
  bool affects_result() const { return on_change != OnChange::nothing; }
  /// Whether a run that began with a may be resumed with b. True for, say, train.iterations.
  bool may_change_on_resume() const { return on_change != OnChange::retrain; }
};

/// The settings that differ, in the order of config_fields.h.
std::vector<SettingChange> config_diff(const Config& a, const Config& b);

/// Whether runs of a and b give the same result: they differ in settings like train.threads or
/// train.log_every at most.
bool same_result(const Config& a, const Config& b);

}  // namespace gs
