// SPDX-License-Identifier: Apache-2.0
// A shell script in place of the program colmap, and photos for it.
#pragma once

#include <filesystem>

#include "tests/support/colmap_writer.h"

namespace gs {

/// In the folder: photos/ with three photos of one size, model/ with their cameras and points, and
/// the script colmap, which always gives this model.
inline void write_fake_colmap(const std::filesystem::path& folder) {
  constexpr int kSide = 40, kRows = 32;  // pixels; SSIM needs 11
  ColmapModel model = small_model(3);
  ColmapCamera& camera = model.cameras.begin()->second;
  camera.width = kSide;
  camera.height = kRows;
  camera.params = {40, 40, 20, 16};
  write_binary_model(folder / "model", model);
  for (const ColmapImage& image : model.images)
    write_png(folder / "photos" / image.name, plain_photo(kSide, kRows, 90));
  write_bytes(folder / "colmap",
              "#!/bin/sh\n"
              "[ \"$1 $2\" = 'mapper --database_path' ] || exit 0\n"
              "while [ \"$1\" != --output_path ]; do shift; done\n"
              "cp -r '" +
                  (folder / "model").string() + "' \"$2/0\"\n");
  std::filesystem::permissions(folder / "colmap", std::filesystem::perms::owner_all);
}

}  // namespace gs
