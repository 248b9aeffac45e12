// SPDX-License-Identifier: Apache-2.0
// The picture that a view is trained on: decoded, masked, undistorted and resized, in this order.
#pragma once

#include <filesystem>

#include "data_loaders/photos/photos.h"
#include "data_loaders/scene/photo.h"

namespace gs {

/// Photo and mask of the view's size. The mask is empty if every pixel trains.
struct Picture {
  Image8 photo, mask;
};

/// Raise it when make_picture() gives other bytes: it is part of the names in the photo cache.
inline constexpr int kPictureVersion = 1;

/// The picture of a view. Throws Error that names the file. For a frame of a video, all frames
/// before it are decoded, too.
Picture make_picture(const Photo& photo);
/// The same from the decoded file.
Picture make_picture(const Photo& photo, PhotoWithAlpha read);

/// The mask in a file, (height, width, 1) of the file's size: its alpha if that is not 255
/// everywhere, and else the brightest channel; in a file without values above 1, 1 stands for 255.
/// Throws Error like read_photo().
Image8 read_mask_file(const std::filesystem::path& file);

/// Pixels outside of `kept` do not train. An empty mask becomes `kept`.
void leave_out(const Image8& kept, Image8& mask);

/// The mask of a photo, (height, width, 1) of its size, 255 where it trains: from the file, or else
/// (`mask` empty) from the photo's alpha. Empty if there is neither, and if all of it is 255. A file
/// of the photo's shape and another size is resized. Throws Error like read_photo().
Image8 read_mask(const MaskUse& use, const std::filesystem::path& mask,
                 const PhotoWithAlpha& photo);

// Undistorting and resizing mix neighboring pixels, so colors from under a mask would show at its
// edge. Before the lens, the edge is filled instead of blackened, since some bicubic weights are
// negative and would ring. For resizing, colors are multiplied by the mask and divided afterwards.

/// Fills pixels of mask 0, up to `reach` pixels from the mask's edge, with the mean color of their
/// neighbors nearer to the edge.
void fill_masked_edge(Image8& photo, const Image8& mask, int reach);

/// Multiplies a photo's colors by its mask.
void multiply_by_mask(Image8& photo, const Image8& mask);
/// The way back; black where the mask is 0.
void divide_by_mask(Image8& photo, const Image8& mask);

/// Share of a picture that trains, 0..1; 1 for an empty mask.
double trained_share(const Image8& mask);

}  // namespace gs
