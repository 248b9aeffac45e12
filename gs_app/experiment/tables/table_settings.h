// SPDX-License-Identifier: Apache-2.0
// The settings in an experiment's tables. Each is shown where the experiment's file states it:
// those of a config with the config, those of a single scene with the scene.
#pragma once

#include "gs_app/experiment/experiment_file.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// {"density.every": 50, ...}: the settings that differ from the defaults.
Json settings_json(const Config& config);

/// The same for a config by itself: its base, the file's [set] and its own `set`, without those of
/// any scene.
Json settings_json(const Experiment& experiment, const ExperimentConfig& config);

/// All settings of a scene's own `set`, also those at their defaults: they override the configs'
/// values.
Json settings_json(const ExperimentScene& scene);

}  // namespace gs
