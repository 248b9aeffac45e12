// SPDX-License-Identifier: Apache-2.0
// A truncated signed distance in blocks of voxels around the surfaces that views show.
//                                                    Curless, Levoy 1996; Niessner et al. 2013
//
//   const VolumeFrame frame = volume_frame(views, voxel, rule);
//   const Volume volume = fuse(views, frame, surface_blocks(views, frame), rule, progress);
//   TriangleMesh mesh = surface_of(volume);                             // marching_cubes.h
//   color_vertices(views, voxel, mesh);
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "gs_render/fusion/depth_view.h"

namespace gs {

inline constexpr int kBlockEdge = 8;                                       // voxels
inline constexpr int kBlockVoxels = kBlockEdge * kBlockEdge * kBlockEdge;  // x runs fastest

struct FusionRule {
  float truncation = 4;  // voxels
  // Space that views have in their pictures, and that none of them sees through, is solid, so that
  // the surface is closed.
  bool is_watertight = false;
};

/// Where blocks are. Voxel (0, 0, 0) of block (bx, by, bz) lies at low + 8 voxel (bx, by, bz). The
/// outermost blocks are air.
struct VolumeFrame {
  Vec3f low;                            // world units
  float voxel = 0;                      // edge of a voxel, world units
  std::uint64_t blocks[3] = {0, 0, 0};  // along each axis

  std::uint64_t count() const { return blocks[0] * blocks[1] * blocks[2]; }
  std::uint64_t key(std::uint64_t x, std::uint64_t y, std::uint64_t z) const {
    return (z * blocks[1] + y) * blocks[0] + x;
  }
  /// A block by its key, along an axis.
  std::uint64_t place(std::uint64_t key, int axis) const {
    return axis == 0 ? key % blocks[0]
                     : key / (axis == 1 ? blocks[0] : blocks[0] * blocks[1]) % blocks[axis];
  }
};

struct Volume {
  VolumeFrame frame;
  std::vector<std::uint64_t> keys;  // (B) ascending
  // (B, 512)  of the truncation, -1 (solid) to 1 (air); NaN: no view says anything
  std::vector<float> distance;
};

/// Called with the number of parts that are done, and of all.
using FusionProgress = std::function<void(std::size_t done, std::size_t total)>;

/// The size of a pixel on the surface that it shows: 1 / (o f), the median over pixels of all
/// views.   world units; 0 where no pixel shows a surface
float median_pixel(const std::vector<DepthView>& views);

/// The box of what the views show, without the outermost hundredth of the points along each axis
/// at either end, and with a twentieth more. `voxel` > 0.
VolumeFrame volume_frame(const std::vector<DepthView>& views, float voxel, const FusionRule& rule);

/// The blocks that a surface meets within the truncation, ascending.
std::vector<std::uint64_t> surface_blocks(const std::vector<DepthView>& views,
                                          const VolumeFrame& frame, const FusionRule& rule);

/// The memory that a volume takes with its mesh.
struct VolumeForecast {
  double voxel = 0;                // that blocks were counted with, world units
  double blocks = 0, lattice = 0;  // near surfaces; of the whole frame, where it is looked through

  /// Bytes with voxels of another size: surfaces have as many more blocks as the square.
  double bytes_at(double size) const;
};
/// Counts the blocks, with voxels as large as the median pixel at least, which is quick.
VolumeForecast forecast_volume(const std::vector<DepthView>& views, float voxel,
                               const FusionRule& rule);

/// Fuses all views, each voxel by itself and in the order of the views, so that the result does not
/// depend on threads. A voxel at p, at depth z on the ray u of a view (z = 1), has there
///
///   d = (1/o - z) cos |u|,   s = min(d / truncation, 1),   weight  g = cos^2 o^2 min(1 + s, 1)
///
/// where o and cos are the pixel's inverse depth and facing, and gets sum g s / sum g over the views
/// with s > -1. Behind a surface the weight falls (Bylow et al. 2013): the ray may have left the
/// thing there. Where three views more than thrice those that see a
/// surface look through a voxel, it is air. Two views must agree that there is anything, if there
/// are two, and of a closed surface one for every eight before which the voxel is hidden.
///
/// blocks  of surface_blocks(); a watertight volume has more
Volume fuse(const std::vector<DepthView>& views, const VolumeFrame& frame,
            std::vector<std::uint64_t> blocks, const FusionRule& rule,
            const FusionProgress& progress = {});

}  // namespace gs
