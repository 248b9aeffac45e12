// SPDX-License-Identifier: Apache-2.0
// Scenes whose cameras stand in transforms.json: nerfstudio's and instant-ngp's form of it, and the
// three files of the NeRF synthetic scenes (Mildenhall et al. 2020) that Blender wrote.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"

namespace gs {

/// Whether a folder holds transforms.json, or transforms_train.json.
bool has_transforms(const std::filesystem::path& folder);

/// Whether it is one of Blender's: transforms_train.json and no transforms.json.
bool is_blender_scene(const std::filesystem::path& folder);

/// What the files of such a scene say.
struct TransformsScene {
  ColmapModel model;                    // no rigs or frames; image names are relative to the folder
  std::vector<std::string> test_names;  // of images of the model, in the files' order
  bool has_split = false;               // the files say which photos are for testing
};

/// Reads transforms.json, or else transforms_train.json and what is for testing with it, into the
/// struct that COLMAP models are read into.
///
///   cameras  equal intrinsics are one camera; ids from 1. A frame's own intrinsics go before those
///            at the top of the file: fl_x fl_y cx cy w h (pixels, the first pixel's corner is 0),
///            or camera_angle_x camera_angle_y (radians) for the focal lengths. One focal length
///            stands for both, the center is that of the picture unless given, the size is that of
///            the photo unless given. `camera_model` and the lens's coefficients become
///              OPENCV (or none given)   PINHOLE where k1 k2 p1 p2 k3 are 0, OPENCV where k3 is, or
///                                       FULL_OPENCV
///              OPENCV_FISHEYE           the same with k1 k2 k3 k4; instant-ngp's is_fisheye too
///              (SIMPLE_)PINHOLE         PINHOLE
///              EQUIRECTANGULAR          the same
///   images   in the files' order; ids from 1. transform_matrix is camera-to-world, in world units,
///            of a camera with OpenGL's axes (x right, y up, z backwards). A file_path without
///            extension leads to the .png, .jpg or .jpeg that exists. Photos need not exist where
///            the file tells their size.
///   points   those of the PLY in ply_file_path, which nerfstudio has in the cameras' world (its
///            applied_transform is in both); gray where it has no colors; ids from 1. Where it
///            cannot be read there are none, and points that are not finite are left out, with a
///            warning.
///   split    of transforms_train/test.json, or _train/val.json where there is no test; or of the
///            lists train_filenames, test_filenames (or else val_filenames). Frames that the lists
///            put to no use are left out; without train_filenames, all others are trained on.
///
/// Throws Error that names the file, the frame, the key and the remedy for all that is broken or
/// not known: among it a matrix that scales, shears or mirrors, names that occur twice or lead out
/// of the folder. No file costs more memory than a small multiple of its size.
TransformsScene read_transforms(const std::filesystem::path& folder);

/// The cameras of one file of that form, whatever its name: no points, no split. Throws Error likewise.
ColmapModel read_transforms_file(const std::filesystem::path& file);

}  // namespace gs
