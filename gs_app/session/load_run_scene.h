// SPDX-License-Identifier: Apache-2.0
// The scene of a run: photos without cameras are reconstructed first, then photos and cameras are
// loaded.
#pragma once

#include <functional>

#include "data_loaders/doctor/forecast.h"
#include "gs_app/run/run_folder.h"
#include "gs_app/session/session_hooks.h"
#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_train/backend.h"

namespace gs {

/// Makes a scene in OUT/scene where dataset.source is a folder of photos alone, or a video, and
/// points the config to it. Does nothing for other sources. `clear_folder` moves an older run in OUT
/// aside; it is called once COLMAP is known to be able to start. Returns whether the source was
/// photos. Throws as run_colmap() does, and UsageError where poses of another program lie beside them.
bool reconstruct_bare_photos(Config& config, const RunFolder& folder,
                             const std::function<void()>& clear_folder, SessionHooks& hooks);

/// Loads the scene at dataset.source, and logs its size. Throws as load_scene() does.
Scene load_run_scene(const DatasetConfig& dataset, SessionHooks& hooks,
                     const SceneNeeds& needs = {});

/// The same for a run. Where photometric.model is "auto" and exposures can be solved for, they
/// choose the model, and the config then names it. Exposures that were solved for that choice alone
/// are forgotten: gains that start from them make neutral pictures worse
/// (docs/method/photometric.md).
Scene load_run_scene(Config& config, SessionHooks& hooks);

/// The choice where it is still open: by the exposures of a scene that somebody else has made, and
/// by a short run where there are none (measure_light.h).
void choose_photometric_model(Config& config, const Scene& scene);

/// Logs what the run is expected to take of the machine. `start`: Gaussians of a model that it starts
/// from; 0: it starts from the points.
void log_forecast(const Config& config, const Scene& scene, Backend& backend, std::size_t start);

/// The device of a backend, as forecast() needs to know it.
ForecastDevice forecast_device(Backend& backend);

}  // namespace gs
