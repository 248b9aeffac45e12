// SPDX-License-Identifier: Apache-2.0
// The normal map that a view is trained on: read, seen by the view's camera, and in its axes.
#pragma once

#include "data_loaders/scene/photo.h"
#include "gs_core/image.h"

namespace gs {

/// The normals of a view's map, (height, width, 3) of its camera: NormalBytes. Between four pixels
/// they are interpolated. Throws Error that names the file. The photo has a normal file.
Image8 make_normals(const Photo& photo);

/// The normal of a map of these axes in those of the camera: x right, y down, z forward.
Vec3f in_camera(const Vec3f& normal, NormalAxes axes, const Camera& camera);

/// Throws Error where the normals of the photos' maps do not look at their cameras, so that they must
/// have other axes than dataset.normal_axes says. Reads some maps. `place` is where they are.
void check_normal_axes(const std::vector<Photo>& photos, const std::string& place);

}  // namespace gs
