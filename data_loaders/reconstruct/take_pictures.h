// SPDX-License-Identifier: Apache-2.0
// Fills the images/ of the work folder with the photos, or with frames of the videos.
#pragma once

#include "data_loaders/reconstruct/colmap_plan.h"
#include "data_loaders/reconstruct/scene_state.h"

namespace gs {

/// Hard links where the file system has them, else copies; upright ones where PhotoFile says so. The
/// photos themselves stay as they are. A photo that turns out to be damaged is taken out of the
/// plan, with a warning. Does nothing where the scene has its photos.
void take_photos(ColmapPlan& plan, SceneFolder& folder, const ColmapProgress& progress);

/// The sharpest frames of each video; a video whose frames are complete is passed over. Completes
/// the plan.
void take_frames_of_videos(ColmapPlan& plan, SceneFolder& folder, const ColmapProgress& progress);

}  // namespace gs
