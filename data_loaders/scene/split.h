// SPDX-License-Identifier: Apache-2.0
// Which views are held out to measure on.
#pragma once

#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/config/config.h"

namespace gs {

/// Whether each image of the model is a test view, in the order of model.images, which are sorted by
/// name. With dataset.eval, every test_every-th frame is held out, the first one among them. The
/// photos that a rig took at one moment are one frame and stay together, for they show nearly the
/// same; every other photo is a frame of its own. Frames are counted in the order of their first
/// names. Throws Error for a model without images; UsageError where nothing is left to train on.
std::vector<bool> test_views_of(const DatasetConfig& dataset, const ColmapModel& model);

}  // namespace gs
