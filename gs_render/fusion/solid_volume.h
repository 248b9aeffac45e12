// SPDX-License-Identifier: Apache-2.0
// A solid of the Gaussians alone, without views: what something can collide with.
#pragma once

#include "gs_core/gaussians.h"
#include "gs_render/fusion/volume.h"

namespace gs {

/// Which air becomes solid, too.
enum class SolidFill {
  inside,   // that which no way leads to from outside: things that are hollow
  outside,  // that which no way leads to from the middle: rooms
  floor,    // that below the lowest solid voxel of each column; down is +y
};

/// Bytes per voxel of the frame until the mesh is written.
inline constexpr double kSolidVoxelBytes = 16;

/// The box of the means of Gaussians that are a tenth opaque, without the outermost hundredth along
/// each axis at either end, and with a twentieth more. The outermost blocks are air. `gaussians` are
/// in host memory, without time. Throws Error where none is so opaque.
///
/// voxel  0: a 128th of the longest side   world units
VolumeFrame solid_frame(const Gaussians& gaussians, float voxel);

/// All blocks of the frame. A voxel at x lets the light T = prod (1 - alpha_i) through, and is solid
/// where T is below one half; its distance is 2 T - 1.
///
///   alpha_i = o_i exp(-d^T (Sigma_i + (voxel/2)^2 I)^-1 d / 2),   d = x - mean_i
///
/// A Gaussian is thus at least as thick as a voxel, so that a wall has no holes. The same bytes for
/// any number of threads. Throws Error where `outside` finds no closed room around the middle.
Volume solid_volume(const Gaussians& gaussians, const VolumeFrame& frame, SolidFill fill);

}  // namespace gs
