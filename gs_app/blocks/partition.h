// SPDX-License-Identifier: Apache-2.0
// A scene in blocks. Cuts upright to the ground give each block a part of space with about the same
// number of sparse points; the parts at the rim have no end. A block trains on the photos that show
// enough of its part and of a border around it, and adds Gaussians there and nowhere else.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "data_loaders/scene/load_scene.h"
#include "gs_core/geometry/cut_tree.h"

namespace gs {

struct PartitionOptions {
  std::size_t blocks = 2;
  double border = 0.1;  // width on each side, as a share of how far the block's points reach
  double least_share =
      0.1;  // of the points of a photo: with fewer in a block, it is not the block's
};

struct Block {
  std::vector<WideHalfSpace> region;  // its part of space with the border; none: all of space
  std::vector<std::string> photos;    // sorted
  std::size_t train_photos = 0, test_photos = 0;
  std::size_t points = 0;          // that its photos show
  std::size_t points_outside = 0;  // of these, outside of the region
  // Gaussians that its run starts with: one for each point, or those of a coarse model
  std::size_t start = 0;
  std::size_t start_outside = 0;  // of these, outside of the region

  bool holds(const Vec3d& place) const;  // whether it is in the region
};

struct Partition {
  Vec3d up{0.0, -1.0, 0.0};  // unit length
  CutTree tree;              // part i is that of block i
  std::vector<Block> blocks;
  std::size_t points = 0;  // of the scene
};

/// The share of each block's region in a view, by something that knows more than the sparse points
/// (picture_shares.h).
using SharesInView =
    std::function<std::vector<double>(std::size_t view, const std::vector<Block>& blocks)>;

/// Divides a scene. All is in the coordinates of the photos' poses. A photo is used by each block
/// that has at least `least_share` of the points that it shows, or of the picture by `in_picture`,
/// if it is given; and in any case by the block that has most of the points. Throws Error for a
/// scene without points, UsageError where a block would have no photo to train on or no point.
Partition make_partition(const SceneOutline& scene, const PartitionOptions& options,
                         const SharesInView& in_picture = {});

}  // namespace gs
