// SPDX-License-Identifier: Apache-2.0
// What is measured of the views of a run that is training or has ended.
#pragma once

#include <optional>

#include "gs_eval/looks/scene_looks.h"
#include "gs_eval/metrics.h"
#include "gs_train/loop/trainer.h"

namespace gs {

/// The appearances of the scene's photos as they are now; empty without photometric.model. Waits
/// for the device.
std::optional<SceneLooks> looks_of(Trainer& trainer);
/// What to measure of the run's views: with photometric.model, the appearances and pictures with
/// fitted colors, too.
EvaluationOptions evaluation_options(Trainer& trainer, MetricSet metrics);

}  // namespace gs
