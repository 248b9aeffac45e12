// SPDX-License-Identifier: Apache-2.0
// From a folder with photos and a COLMAP model to the Scene that training starts from.
#pragma once

#include <functional>

#include "gs_core/config/config.h"
#include "gs_core/scene.h"

namespace gs {

/// Called after each photo, from one thread at a time, with `done` counting up to `total`.
using ProgressFn = std::function<void(std::size_t done, std::size_t total)>;

/// First the headers of all photos are read; then all photos, if they fit into memory.
enum class LoadStage { refinement, headers, photos };
using LoadProgress = std::function<void(LoadStage stage, std::size_t done, std::size_t total)>;

/// Finds the model and the photos, undistorts and resizes every photo to dataset.resolution, and
/// splits the views: with dataset.eval, every test_every-th in byte order of the names, the first
/// one among them, is a test view (split.h: photos of one rig frame stay together). Every size and name is checked before the first photo is
/// decoded. Photos that do not fit into dataset.photo_ram_gib as a whole are decoded when they are asked for, by a
/// PhotoPool. Throws Error that names the file and the remedy; UsageError for a resolution or a budget that
/// cannot be taken.
/// With dataset.refine_cameras the model is refined first. With PhotoLoading::when_asked no photo is decoded before it is
/// asked for, whatever would fit: for those who look at some.
enum class PhotoLoading { as_they_fit, when_asked };
Scene load_scene(const DatasetConfig& dataset, const LoadProgress& progress = {},
                 PhotoLoading loading = PhotoLoading::as_they_fit);

/// All that load_scene() checks before it decodes the first photo; cameras are not refined. Throws like it.
void check_scene(const DatasetConfig& dataset);

}  // namespace gs
