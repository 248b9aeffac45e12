// SPDX-License-Identifier: Apache-2.0
// Panoramas of 360 degrees for COLMAP, which knows no lens of theirs in most versions: each is cut
// into pinhole views around it, which are a rig with known turns, and their poses give its own.
#pragma once

#include "data_loaders/reconstruct/colmap_plan.h"

namespace gs {

/// Views of a panorama: 90 degrees wide and high, level, one every 60 degrees.
inline constexpr int kPanoramaViews = 6;

/// The views of all panoramas as COLMAP reads them, below plan.files.views(): "K/00012.jpg" is view
/// K of panorama 12. All have one size and are cameras of one lens.
std::vector<PhotoFile> panorama_views(const ColmapPlan& plan);
/// Their lens in COLMAP's order of PINHOLE.
std::string panorama_view_params(const ColmapPlan& plan);

/// Cuts those that are not there yet. `progress` counts panoramas.
void cut_panoramas(const ColmapPlan& plan, const ColmapProgress& progress);

/// Writes what COLMAP's rig_configurator reads (version 3.12 and later).
void write_rig_of_views(const std::filesystem::path& file);
/// Writes what its rig_bundle_adjuster reads (before 3.12), which tells cameras by their numbers in
/// a model.
void write_rig_of_views(const std::filesystem::path& file, const ColmapModel& of_views);

/// The model of the panoramas whose views a model has placed, with the views' observations. Views
/// that contradict the others of their panorama are left out.
ColmapModel panorama_model(const ColmapPlan& plan, const ColmapModel& of_views);

}  // namespace gs
