// SPDX-License-Identifier: Apache-2.0
// Camera poses of other programs: an input is read as a file of each of them, and the list of Bundler's
// photos stands behind its file.
#include "data_loaders/foreign/foreign_scene.h"

#include <cmath>

#include "data_loaders/photos/encode/encode_png.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/colmap_writer.h"

namespace gs::fuzz {
namespace {

constexpr const char* kForeignFiles[] = {"metashape/cameras.xml",       "realityscan/poses.csv",
                                         "opensfm/reconstruction.json", "openmvg/sfm_data.json",
                                         "meshroom/cameras.sfm",        "polycam/cameras/a.json",
                                         "record3d/metadata.json",      "mvsnet/cams/a_cam.txt"};

bool make_foreign_folders() {
  for (const char* name : kForeignFiles)
    std::filesystem::create_directories((folder() / name).parent_path());
  std::filesystem::create_directories(folder() / "bundler");
  std::filesystem::create_directory(folder() / "photos");
  for (const char* name : {"a.png", "b.png", "0.png"})
    write_png(folder() / "photos" / name, plain_photo(12, 8, 77));
  return true;
}

void read_foreign(const std::filesystem::path& file) {
  const ColmapModel model = read_foreign_scene(file, folder() / "photos");
  for (const ColmapImage& image : model.images) {
    require(model.cameras.contains(image.camera_id), "an image has no camera");
    require(is_finite(image.cam_from_world_translation), "a camera stands nowhere");
    require(std::abs(squared_norm(image.cam_from_world_rotation) - 1) < 1e-6, "no rotation");
  }
  for (const ColmapPoint& point : model.points)
    require(is_finite(point.position), "a point is nowhere");
}

void read(std::string_view bytes) {
  static const bool is_ready = make_foreign_folders();
  require(is_ready, "no folders");
  for (const char* name : kForeignFiles) takes([&] { read_foreign(file_of(name, bytes)); });
  write_files(bytes, {"bundler/bundle.out", "bundler/list.txt"});
  takes([] { read_foreign(folder() / "bundler/bundle.out"); });
}

const Registered registered{"foreign", read};

}  // namespace
}  // namespace gs::fuzz
