// SPDX-License-Identifier: Apache-2.0
// The evaluation after the last step, with its pictures.
#pragma once

#include <functional>

#include "gs_app/pictures/comparison.h"
#include "gs_app/run/results.h"
#include "gs_app/run/run_folder.h"
#include "gs_train/loop/trainer.h"

namespace gs {

/// Renders all test views and some training views, and compares them with their photos: the figures
/// go to `results`, the pictures to test/ours_N/{renders,gt} (train/ours_N where no view is held
/// out) and comparison.png. FLIP and, where `lpips` is not null, LPIPS are measured of the
/// views with pictures. Where no view is held out, and neither LPIPS nor eval.color_corrected is
/// asked for, nothing is measured. `progress` counts views. Returns the pictures that a report shows.
ShownViews evaluate_run(Trainer& trainer, const RunFolder& folder, Lpips* lpips, Results& results,
                        const std::function<void(std::size_t done, std::size_t total)>& progress);

/// The results of a finished run, before its evaluation; the hash of its scene is left empty.
Results results_of(Trainer& trainer);

/// The GPU memory that this run takes at most by the forecast: for its Gaussians, or those that it
/// has memory for from the start.
double forecast_gpu_bytes(Trainer& trainer);

}  // namespace gs
