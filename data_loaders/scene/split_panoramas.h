// SPDX-License-Identifier: Apache-2.0
// Panoramas become two photos each: hemispheres.h has their pictures.
#pragma once

#include "data_loaders/scene/scene_model.h"

namespace gs {

/// An image of a split model: the one of the model before, or one of its halves.
struct SplitImage {
  std::size_t image;
  bool is_back;
};

/// Replaces each EQUIRECTANGULAR image by its two hemispheres, for which its camera is that of
/// lens_camera(): `a/pano.jpg` becomes `a/pano.front.jpg` and `a/pano.back.jpg`. They share its
/// observations and are one frame, which moves as one. Images that are sorted by name stay so.
std::vector<SplitImage> split_panoramas(ColmapModel& model);

/// The same of a scene, of its photos, too. Returns the number of panoramas.
std::size_t split_panoramas(SceneModel& scene);

/// What becomes of panoramas, in one line.
std::string text_of_panoramas(std::size_t count);

/// The size of the picture that a file becomes, before it is resized: its own, or that of a
/// hemisphere.
PhotoSize picture_size(const PhotoSize& file, const ColmapCamera& camera);

}  // namespace gs
