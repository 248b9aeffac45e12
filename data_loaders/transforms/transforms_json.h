// SPDX-License-Identifier: Apache-2.0
// Scenes with their cameras in transforms.json: nerfstudio's and instant-ngp's form of it, and the
// three files of the NeRF synthetic scenes (Mildenhall et al. 2020), written by Blender.
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

/// The content of such files.
struct TransformsScene {
  ColmapModel model;                    // no rigs or frames; image names are relative to the folder
  std::vector<std::string> test_names;  // of images of the model, in the files' order
  bool has_split = false;               // the files name the photos for testing
  std::size_t time_count = 0;           // different values of `time`; 2 and more: the scene moves
};

/// Reads transforms.json, or else transforms_train.json and the file of its test photos, into the
/// struct of COLMAP models.
///
///   cameras  equal intrinsics are one camera; ids from 1. A frame's own intrinsics go before those
///            at the top of the file: fl_x fl_y cx cy w h (pixels, the first pixel's corner is 0),
///            or camera_angle_x camera_angle_y (radians) for the focal lengths. One focal length
///            stands for both. Without cx and cy the center is that of the picture; without w and h
///            the size is that of the photo. `camera_model` and the lens's coefficients become
///              OPENCV (or none given)   PINHOLE where k1 k2 p1 p2 k3 are 0, OPENCV where k3 is, or
///                                       FULL_OPENCV
///              OPENCV_FISHEYE           the same with k1 k2 k3 k4; instant-ngp's is_fisheye too
///              (SIMPLE_)PINHOLE         PINHOLE
///              EQUIRECTANGULAR          the same
///   images   in the files' order; ids from 1. transform_matrix is camera-to-world, in world units,
///            of a camera with OpenGL's axes (x right, y up, z backwards). A file_path without
///            extension leads to the .png, .jpg or .jpeg that exists. Photos need not exist if the
///            file has their size.
///   shutter  transform_matrix_start and transform_matrix_end instead of transform_matrix are the poses
///            while the first and the last row were exposed (instant-ngp); rolling_shutter, of the
///            frame or at the top, is [0, 0, 1, 0], rows from the top down, or absent. Between them
///            the center goes straight, and the camera turns evenly.
///   points   those of the PLY in ply_file_path, in the cameras' world (nerfstudio applies its
///            applied_transform to both); gray if the PLY has no colors; ids from 1. A PLY that
///            cannot be read gives none, and points that are not finite are left out, each with a
///            warning.
///   split    transforms_train.json and transforms_test.json, or transforms_val.json if there is no
///            test; or the lists train_filenames and test_filenames (or else val_filenames). Frames
///            in none of the lists are left out; without train_filenames, they are trained on.
///   time     of a frame: 0 to 1 in the D-NeRF scenes (Pumarola et al. 2021). If a time lies outside,
///            all are moved and scaled, so that the first photo has 0 and the last 1.
///
/// Throws Error that names the file, the frame, the key and the remedy. Refused are, for example, a
/// matrix that scales, shears or mirrors, and names that occur twice or lead out of the folder. No
/// file costs more memory than a small multiple of its size.
TransformsScene read_transforms(const std::filesystem::path& folder);

/// The cameras of one file of that form under any name, without points or split. Throws Error like
/// read_transforms().
ColmapModel read_transforms_file(const std::filesystem::path& file);

}  // namespace gs
