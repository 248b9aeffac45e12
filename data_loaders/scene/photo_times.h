// SPDX-License-Identifier: Apache-2.0
// When photos were taken, in scenes of COLMAP, whose models do not say: cameras that stand still and
// film, or one camera that moves and films (dataset.times). The frames are pictures, or in videos.
#pragma once

#include <filesystem>
#include <string>

#include "data_loaders/scene/scene_model.h"

namespace gs {

/// Gives the photos of a scene times by dataset.times.
///
/// frames   Cameras that stand still. Each image of the model stands for one camera, and becomes as
///          many images and photos as the camera has frames, with the image's pose and lens; those
///          of a held-out camera are held out. The frames of
///
///            images/cam00.png or images/cam00/0000.png   in the model
///
///          are the pictures in images/cam00, by name, or else those of the video images/cam00.mp4
///          (or with another ending of videos), named cam00/00001.png and so on as ffmpeg would name
///          them. Frame i of n has the time i / (n - 1).
/// names    One film: the last number in each photo's name, moved and scaled so that the first photo
///          has 0 and the last 1. For example, frame_0012.png and frame_0024.png of frame_0012 to
///          frame_0036 have 0 and 0.5.
///
/// Throws Error for a camera without frames, where cameras have different numbers of frames, and for
/// a name without a number; UsageError where dataset.times does not go with the scene or with another
/// setting.
void find_times(const DatasetConfig& dataset, SceneModel& scene);

/// The video of a camera in the folder of photos: `camera` is a path in it without ending. Empty if
/// there is none. Throws Error for several.
std::filesystem::path video_of_camera(const std::filesystem::path& images,
                                      const std::string& camera);

}  // namespace gs
