// SPDX-License-Identifier: Apache-2.0
// Scenes and cameras in JSON: transforms.json with its points, Blender's two files, cameras.json and
// film paths. An input is one file, or two, one behind the other.
#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/transforms/transforms_json.h"

#include "data_loaders/cameras/read_cameras.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/colmap_writer.h"

namespace gs::fuzz {
namespace {

/// Folders with a photo whose size the frames may leave out.
bool make_folders() {
  for (const char* name : {"transforms", "blender"}) {
    std::filesystem::create_directory(folder() / name);
    write_png(folder() / name / "a.png", plain_photo(12, 8, 77));
  }
  return true;
}

void read_finite_cameras(const std::filesystem::path& file) {
  for (const NamedCamera& camera : read_cameras(file, Vec3d(1e6, 0.0, 0.0)))
    require(is_finite(camera.camera.position()), "a camera stands nowhere");
}

void read(std::string_view bytes) {
  static const bool is_ready = make_folders();
  require(is_ready, "no folder");
  write_files(bytes, {"transforms/transforms.json", "transforms/points.ply"});
  takes([] { read_transforms(folder() / "transforms"); });
  takes([] { read_finite_cameras(folder() / "transforms/transforms.json"); });
  write_files(bytes, {"blender/transforms_train.json", "blender/transforms_test.json"});
  takes([] { read_transforms(folder() / "blender"); });
}

const Registered registered{"transforms", read};

}  // namespace
}  // namespace gs::fuzz
