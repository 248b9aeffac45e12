// SPDX-License-Identifier: Apache-2.0
// Quality over training time as a picture: quality.svg of an experiment.
#pragma once

#include <string>
#include <vector>

#include "gs_app/experiment/tables/table_rows.h"

namespace gs {

/// An SVG with PSNR and SSIM of the held-out views over the seconds of training: a row of two charts
/// for each scene, thin lines for runs, and for each config a bold line through the means over
/// seeds of time and metric at each step that all its runs evaluated. The points are the
/// evaluations in metrics.csv of finished runs: at the end, and at `train.test_steps`. Empty if
/// there are none. A metrics.csv that is damaged is left out.
std::string quality_curves(const std::vector<RunRow>& rows);

}  // namespace gs
