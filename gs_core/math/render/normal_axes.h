// SPDX-License-Identifier: Apache-2.0
// What the numbers of normal maps mean.
#pragma once

namespace gs {

/// The axes that the numbers of a map's normals belong to: those of the scene, or of the camera. The
/// letters say where +x, +y and +z point there: right or left, up or down, forward or back.
enum class NormalAxes { world, rdf, rub, lub };

}  // namespace gs
