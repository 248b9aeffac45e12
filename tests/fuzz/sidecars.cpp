// SPDX-License-Identifier: Apache-2.0
// Small JSON files beside models and scenes: the sidecar of an export, exposure.json, photometric.json,
// poses.json, split.json, georef.json, blocks.json, places and lists of photos as text, and
// reconstruct.json, which says what folder may be removed; and areas, in GeoJSON or as text.
#include "gs_model/formats/sidecar.h"

#include "data_loaders/cameras/exposure_file.h"
#include "data_loaders/georef/georef_file.h"
#include "data_loaders/georef/gps_places.h"
#include "data_loaders/reconstruct/colmap_plan.h"
#include "data_loaders/reconstruct/scene_state.h"
#include "data_loaders/scene/photo_list.h"
#include "gs_app/blocks/blocks_file.h"
#include "gs_app/run/photometric_file.h"
#include "gs_app/run/pose_file.h"
#include "gs_app/run/run_folder.h"
#include "gs_model/edit/places/polygon_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {
namespace {

namespace fs = std::filesystem;

void read(std::string_view bytes) {
  GaussianModel model;
  takes([&] {
    const fs::path file = folder() / "model.ply";
    file_of("model.ply.transforms.json", bytes);
    take_sidecar(file, model);
  });
  takes([&] { read_polygon(file_of("area.txt", bytes)); });
  takes([&] { read_exposures(file_of("exposure.json", bytes)); });
  takes([&] { read_photometric(file_of("photometric.json", bytes)); });
  takes([&] { read_poses(file_of("poses.json", bytes)); });
  takes([&] {
    const Georeference read = read_georef(file_of("georef.json", bytes));
    require(is_finite(read.ecef_of_input({1.0, 2.0, 3.0})), "a georeference leads to no place");
  });
  takes([&] { read_gps_file(file_of("gps.txt", bytes)); });
  takes([&] { photos_in_list(file_of("photos.txt", bytes), {"a.jpg", "left/b.jpg"}); });
  takes([&] {
    const CutTree tree = read_blocks(file_of("blocks.json", bytes)).tree;
    require(tree.part_of({1.0, 2.0, 3.0}) < tree.parts(), "a place is in no block");
    for (std::size_t part = 0; part < tree.parts(); ++part) tree.bounds_of(part);
  });
  takes([&] {
    file_of("split.json", bytes);
    split_names(RunFolder(folder()), "test");
  });
  takes([&] {
    file_of("reconstruct.json", bytes);
    if (const auto state = read_state({folder()}))
      require(state->work.empty() || is_work_folder(state->work), "a work folder is not ours");
  });
}

const Registered registered{"sidecars", read};

}  // namespace
}  // namespace gs::fuzz
