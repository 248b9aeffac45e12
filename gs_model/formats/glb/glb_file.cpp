// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/glb/glb_file.h"

#include <cmath>

namespace gs {

void check_nodes(const GlbFile& glb) {
  static const SortedJson kStill = {{"matrix", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}},
                                    {"rotation", {0, 0, 0, 1}},
                                    {"scale", {1, 1, 1}},
                                    {"translation", {0, 0, 0}}};
  for (const SortedJson& node : glb.list("nodes"))
    for (const auto& [key, still] : kStill.items())
      if (const SortedJson* value = GlbFile::find(node, key.c_str()); value && *value != still)
        cannot_read(
            glb.path(),
            "a node turns, scales or moves what it shows, and gemsplat reads the numbers as "
            "they are; apply the node in the program that wrote the file, and export it "
            "again");
}

Vec3d world_offset_of(const GlbFile& glb) {
  Vec3d offset(0.0);
  for (const SortedJson& node : glb.list("nodes")) {
    const SortedJson* extras = GlbFile::find(node, "extras");
    const SortedJson* list = extras ? GlbFile::find(*extras, "world_offset") : nullptr;
    if (!list) continue;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!list->is_array() || list->size() != 3 || !(*list)[axis].is_number() ||
          !std::isfinite((*list)[axis].get<double>()))
        glb.fail("has a \"world_offset\" that is not 3 numbers");
      offset[int(axis)] = (*list)[axis].get<double>();
    }
  }
  return offset;
}

}  // namespace gs
