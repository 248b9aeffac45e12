// SPDX-License-Identifier: Apache-2.0
// The plan for each photo, decided from its header: its lens, its sizes, its camera.
#pragma once

#include <functional>

#include "data_loaders/scene/scene_model.h"
#include "gs_core/config/config_words.h"

namespace gs {

/// Reads the headers of all photos, masks and depth maps and plans the photos. `progress` counts
/// headers, from one thread at a time. Throws Error that names the photo and the remedy: a photo,
/// mask or depth map of another shape than its camera, a lens that cannot become a pinhole and must, a
/// depth map of a view through a wide lens or with a rolling shutter, a pose beyond single
/// precision. Throws UsageError for a resolution that is none.
void plan_photos(SceneModel& scene, LensUse lens, int resolution,
                 const std::function<void(std::size_t done, std::size_t total)>& progress);

/// Sets Photo::shown: the points of each image's track, if the model was read with Tracks::read and
/// has any. Else the points in the picture of its camera; they may be hidden by others.
void find_shown_points(SceneModel& scene);

/// Plans the photo without its depth map.
void leave_out_depth(Photo& photo);

/// Reads how the photos were exposed, from their headers. Frames of videos have no such tags.
void read_exposure_stops(std::vector<Photo>& photos);

}  // namespace gs
