// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/model_mesh.h"

#include "data_loaders/photos/photos.h"
#include "gs_app/run/output_place.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/system/files/scratch_folder.h"

namespace gs {

namespace fs = std::filesystem;

fs::path mesh_beside(const fs::path& model) {
  for (const fs::path& mesh : {model / "mesh.glb", beside(model, "-mesh.glb")})
    if (fs::is_regular_file(mesh)) return mesh;
  return {};
}

void decode_texture(MeshOfFile& file) {
  if (file.texture_png.empty()) return;
  const ScratchFolder folder;  // photos are decoded from files alone
  const fs::path picture = folder.path() / "texture.png";
  write_text(picture, file.texture_png);
  file.mesh.texture = read_photo(picture);
  file.texture_png.clear();
}

}  // namespace gs
