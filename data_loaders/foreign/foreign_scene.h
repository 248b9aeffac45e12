// SPDX-License-Identifier: Apache-2.0
// Scenes whose cameras other programs have placed.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "data_loaders/colmap/colmap_model.h"

namespace gs {

/// The first 4096 bytes of a file, ASCII letters in lower case; empty if it cannot be read.
std::string beginning_of(const std::filesystem::path& file);

/// A file with camera poses, and the program that wrote it.
struct ForeignScene {
  std::filesystem::path file;
  const char* program;
};

/// The first such file of a scene's folder and the three levels below it, by its name and what it
/// begins with; or the file itself that is given. Programs in the order of this table:
///
///   Metashape     *.xml (File, Export, Export Cameras, type Agisoft XML)
///   RealityScan   *.csv (Registration, Internal/External camera parameters); RealityCapture, too
///   OpenSfM       reconstruction.json; OpenDroneMap, too
///   OpenMVG       sfm_data*.json
///   Meshroom      *.sfm, or *.json with the same content (AliceVision)
///   Bundler       *.out with a list of photos beside it (list.txt, or the same name with .txt)
///   Polycam       keyframes/corrected_cameras/*.json, or else keyframes/cameras/*.json
///   Record3D      metadata.json or metadata, beside photos that are numbered
///   MVSNet        cams/*_cam.txt
std::optional<ForeignScene> find_foreign_scene(const std::filesystem::path& scene);

/// The folder that the photos of such a file lie in or below: `named` in the scene if there is one,
/// or else the scene.
std::filesystem::path foreign_photos(const std::filesystem::path& scene,
                                     const std::filesystem::path& named);

/// Reads the file that find_foreign_scene() has found. Names of images are relative to `photos`. A
/// label without an ending or a folder means the one photo of that name; poses without a photo are
/// left out with a warning. Points are read where the file has them. Throws Error that names the
/// file, what is wrong with it, and a remedy.
ColmapModel read_foreign_scene(const std::filesystem::path& file,
                               const std::filesystem::path& photos);

}  // namespace gs
