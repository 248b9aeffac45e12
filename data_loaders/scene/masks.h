// SPDX-License-Identifier: Apache-2.0
// Which pixels of a photo train: mask files beside the photos, or the photos' own alpha.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/photos/photos.h"
#include "data_loaders/scene/find_scene.h"
#include "gs_core/config/config.h"
#include "gs_core/scene.h"

namespace gs {

/// Where masks come from, and what they mean.
struct MaskSource {
  std::filesystem::path folder;  // of mask files; empty: there are none
  std::filesystem::path images;  // what photos' names are relative to
  bool is_named = false;         // by dataset.masks; else it was only found
  bool use_alpha = true;         // of photos without a mask file
  bool over_background = false;  // masked pixels show the background; else they are ignored
  bool invert = false;           // mask files: black trains
};

/// dataset.masks, mask_mode and invert_masks for a scene. Throws Error where dataset.masks is no folder.
MaskSource find_masks(const DatasetConfig& dataset, const SceneFolders& folders);

/// The mask file of each photo, empty where it has none; `names` as in the model, `photos` their files. Of photo a/b.jpg
/// it is, in the masks' folder, the first of
///   a/b.jpg.png   COLMAP's        a/b.jpg       the same name
///   a/b.png       the ending changed, where no other photo has that name
///   a/b.mask.png, a/b_mask.png
/// with any other picture's ending in place of .png where there is one file of it. Warns with a count where only some
/// photos have one. Throws Error where a photo could have two, and where a folder named by dataset.masks has none at all.
///
/// `of_model`: mask files that the model itself names (empty paths where it names none). They go before those of a folder that
/// was only found, and are not asked for where dataset.masks says something else.
std::vector<std::filesystem::path> match_masks(const MaskSource& source,
                                               const std::vector<std::string>& names,
                                               const std::vector<std::filesystem::path>& photos,
                                               const std::vector<std::filesystem::path>& of_model);

/// Refuses a mask of another shape than its photo, from its header. Throws Error that names both files.
void check_mask_size(const std::filesystem::path& mask, const std::filesystem::path& photo,
                     const PhotoSize& photo_size);

/// The mask of a photo, (height, width, 1) of its size, 255 where it trains: from the file, or else (`mask` empty) of the
/// photo's alpha. Empty where there is neither, and where all is 255. Of a mask file counts its alpha, if that is not 255
/// everywhere, or else the brightest channel; a file with nothing above 1 has 1 for 255. One of the photo's shape and
/// another size is resized (area_resized()). Throws Error like read_photo.
Image8 read_mask(const MaskSource& source, const std::filesystem::path& mask,
                 const PhotoWithAlpha& photo);

// Where pixels are mixed, what a mask covers would show at its edge. Before a photo goes through its lens the edge is
// filled (the lens's bicubic weights are negative in part: black would ring), and it is resized in colors multiplied by
// the mask.

/// Gives pixels of mask 0, up to `reach` pixels from others, the mean color of their neighbors nearer to those.
void fill_masked_edge(Image8& photo, const Image8& mask, int reach);

/// A photo's colors multiplied by its mask, and back again where the mask is not 0; black where it is.
void multiply_by_mask(Image8& photo, const Image8& mask);
void divide_by_mask(Image8& photo, const Image8& mask);

/// Share of a picture that trains, 0..1; 1 of an empty mask.
double trained_share(const Image8& mask);

}  // namespace gs
