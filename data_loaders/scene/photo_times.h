// SPDX-License-Identifier: Apache-2.0
// When photos were taken, in scenes of COLMAP, whose models do not say: cameras that stand still and
// film, or one camera that moves and films (dataset.times). The frames are pictures, or in videos.
#pragma once

#include <filesystem>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/config/config.h"

namespace gs {

/// The frames of cameras that stand still. Each image of the model stands for one camera, and becomes
/// as many images as the camera has frames, with the image's pose and lens. The frames of
///
///   images/cam00.png or images/cam00/0000.png   in the model
///
/// are the pictures in images/cam00, by name, or else those of the video images/cam00.mp4 (or with
/// another ending of videos), named cam00/00001.png and so on as ffmpeg would name them. Frame i of n
/// has the time i / (n - 1). `is_test` gets the entry of the camera for each frame, so that a
/// held-out camera is held out whole.
///
/// Throws Error for a camera without frames, and where cameras have different numbers of frames.
/// Returns the number of times.
std::size_t add_frames_of_cameras(const std::filesystem::path& images, ColmapModel& model,
                                  std::vector<bool>& is_test);

/// The video of a camera in the folder of photos: `camera` is a path in it without ending. Empty if
/// there is none. Throws Error for several.
std::filesystem::path video_of_camera(const std::filesystem::path& images,
                                      const std::string& camera);

/// The times of one film: the last number in each photo's name, moved and scaled so that the first
/// photo has 0 and the last 1. For example, frame_0012.png and frame_0024.png of frame_0012 to
/// frame_0036 have 0 and 0.5. Throws Error for a name without a number. Returns the number of
/// different times.
std::size_t set_times_by_name(ColmapModel& model);

}  // namespace gs
