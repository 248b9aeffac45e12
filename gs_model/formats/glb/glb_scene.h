// SPDX-License-Identifier: Apache-2.0
// What of a .glb is Gaussians: the primitives that the nodes of its scene show, and where each one
// stands.
#pragma once

#include <vector>

#include "gs_model/formats/glb/glb_file.h"
#include "gs_model/formats/model_transform.h"

namespace gs {

/// A primitive of Gaussians as one node shows it.
struct GlbInstance {
  const SortedJson* primitive = nullptr;
  Mat4d scene_from_primitive;  // turns, scales evenly and moves; axes of glTF
  Vec3d world_offset{0.0, 0.0,
                     0.0};  // of "world_offset" in the extras of a node that does not move
};

/// The extensions of a primitive that hold its Gaussians, or null where it has none.
const SortedJson* gaussians_in(const SortedJson& primitive);
/// The entry of an .spz inside, under any name that it has had; null without one.
const SortedJson* spz_in(const SortedJson& extensions);

/// The instances of the file's scene, in the order of its nodes; of a file without a scene, every
/// primitive once. Throws Error, with the file and a remedy, where there are none, where nodes
/// mirror, stretch or shear, and where they are no tree.
std::vector<GlbInstance> glb_instances(const GlbFile& glb);

}  // namespace gs
