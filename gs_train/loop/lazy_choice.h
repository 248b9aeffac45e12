// SPDX-License-Identifier: Apache-2.0
// Whether a run leaves updates of SH for later (optimizer.lazy).
#pragma once

#include "gs_train/loop/training_run.h"

namespace gs {

/// Rows that photos see, as shares of all of them.
struct SeenShares {
  double by_update = 1;  // by at least one photo of an update
  double by_photos = 1;  // summed over the photos of an update
  int photos = 1;
};

/// Bytes that an update of a row moves on a GPU in the mean, if all of it is updated at once and if
/// SH is left for later. `arrays` and `form` say what a row has.
double prompt_update_bytes(const Gaussians& arrays, MomentForm form);
double lazy_update_bytes(const Gaussians& arrays, MomentForm form, const SeenShares& seen);

/// Throws UsageError where optimizer.lazy = "on" does not go with the backend or other settings.
void check_lazy(const Config& config, const Backend& backend);

/// Before the first step of a run, also of one that goes on or back: makes the model what the words
/// "on" and "off" ask for. With "auto" it stays as it is. With "offload" a run begins as its memory
/// is, and stays so when it goes on with another train.offload: the result is the same.
void begin_or_end_lazy(TrainingRun& run);

/// After a step: with "auto", renders the views of some updates after a tenth of the run, counts
/// the rows that they see, and begins to update lazily if that moves fewer bytes, on backends where
/// that is faster. The choice is part of the model, so that a resumed run has the same.
void choose_lazy(TrainingRun& run, int step);

}  // namespace gs
