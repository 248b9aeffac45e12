// SPDX-License-Identifier: Apache-2.0
// A truncated signed distance in blocks of voxels around the surfaces that views show.
//                                                    Curless, Levoy 1996; Niessner et al. 2013
#pragma once

#include <cstdint>
#include <vector>

#include "gs_core/types.h"

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

  GS_HD std::uint64_t count() const { return blocks[0] * blocks[1] * blocks[2]; }
  GS_HD std::uint64_t key(std::uint64_t x, std::uint64_t y, std::uint64_t z) const {
    return (z * blocks[1] + y) * blocks[0] + x;
  }
  /// A block by its key, along an axis.
  GS_HD std::uint64_t place(std::uint64_t key, int axis) const {
    return axis == 0 ? key % blocks[0]
                     : key / (axis == 1 ? blocks[0] : blocks[0] * blocks[1]) % blocks[axis];
  }
  /// Where a block's first voxel lies.
  GS_HD Vec3f corner(std::uint64_t key) const {
    Vec3f at = low;
    for (int axis = 0; axis < 3; ++axis) at[axis] += voxel * float(kBlockEdge * place(key, axis));
    return at;
  }
  /// Where a voxel of a block lies whose first one is at `corner`.
  GS_HD Vec3f voxel_at(const Vec3f& corner, int v) const {
    return corner + voxel * Vec3f(float(v % kBlockEdge), float(v / kBlockEdge % kBlockEdge),
                                  float(v / (kBlockEdge * kBlockEdge)));
  }
  /// Whether a block is one of the outermost.
  GS_HD bool is_border(std::uint64_t key) const {
    for (int axis = 0; axis < 3; ++axis)
      if (const std::uint64_t at = place(key, axis); at == 0 || at + 1 == blocks[axis]) return true;
    return false;
  }
};

/// What a block is without a look at views: all solid, all air, or neither.
enum class BlockKind : std::int8_t { solid = -1, mixed = 0, air = 1 };

struct Volume {
  VolumeFrame frame;
  std::vector<std::uint64_t> keys;  // (B) ascending
  // (B, 512)  of the truncation, -1 (solid) to 1 (air); NaN: no view says anything
  std::vector<float> distance;
};

}  // namespace gs
