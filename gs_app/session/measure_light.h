// SPDX-License-Identifier: Apache-2.0
// How much the photos of a scene differ in light where exposures cannot be solved for, because its
// points have no tracks: a short run on reduced photos learns a gain of each photo.
#pragma once

#include "data_loaders/scene/photo_light.h"
#include "gs_core/config/config.h"
#include "gs_core/scene.h"

namespace gs {

/// The root mean square of the log gains that such a run learns, over the training photos and the
/// three channels. For example, 0.1 where photos are brighter or darker than their mean by 10 %.
/// Takes some seconds on a GPU, and has a backend of its own there. Device, seed and photo memory are
/// those of `config`.
double gain_spread(const Config& config, const Scene& scene);

/// What photometric.model = "auto" chooses by gain_spread(). No model in a scene without points,
/// from which a short run would not get far.
PhotometricChoice choose_photometric_by_run(const Config& config, const Scene& scene);

}  // namespace gs
