// SPDX-License-Identifier: Apache-2.0
// What a photometric model starts from.
#pragma once

#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_train/photometric/photometric_model.h"
#include "gs_train/training_model.h"

namespace gs {

/// Gives the model the numbers that photometric.model learns: the exposures of the training views
/// where they were solved for, else those that EXIF promises (stops_gain()), else zeros. Does
/// nothing without such a model, and where the numbers are there already. Throws Error where those
/// are of other photos.
void begin_photometric(const Config& config, const Scene& scene, TrainingModel& model);

/// The gain of a photo that EXIF says to be exposed by so many stops more than the mean:
///
///   2^(kGainOfStop stops)
///
/// The pixels of photos are display values, which grow with about the square root of the light.
float stops_gain(float stops);
inline constexpr float kGainOfStop = 0.5f;

}  // namespace gs
