// SPDX-License-Identifier: Apache-2.0
// What files of Gaussians and of meshes have in common.
#pragma once

#include <string>
#include <vector>

#include "gs_model/formats/coding/zip_file.h"
#include "gs_model/formats/usd/usd.h"
#include "gs_model/formats/usd/usd_layer.h"

namespace gs {

/// A stage /Scene with a prim, and with /Scene/Cameras where there are views without a lens.
UsdLayer usd_scene(UsdPrim prim, const std::vector<NamedView>& views);
/// Adds gemsplat:worldOffset, where it is not 0.
void add_world_offset(UsdPrim& prim, const Vec3d& offset);
/// A .usdz of these files, of which the first is the layer to open.
std::string usd_package(const std::vector<ZipEntry>& files);

}  // namespace gs
