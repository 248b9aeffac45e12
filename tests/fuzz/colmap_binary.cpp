// SPDX-License-Identifier: Apache-2.0
// A binary COLMAP model. Its files stand one behind the other in an input.
#include "tests/fuzz/colmap_folder.h"

namespace gs::fuzz {
namespace {

void read(std::string_view bytes) {
  std::filesystem::create_directory(folder() / "binary");
  write_files(bytes, {"binary/cameras.bin", "binary/images.bin", "binary/points3D.bin",
                      "binary/rigs.bin", "binary/frames.bin"});
  read_colmap_folder(folder() / "binary");
}

const Registered registered{"colmap_binary", read};

}  // namespace
}  // namespace gs::fuzz
