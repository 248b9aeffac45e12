// SPDX-License-Identifier: Apache-2.0
#include "gs_app/blocks/partition.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/error.h"
#include "gs_core/geometry/scene_frame.h"

namespace gs {
namespace {

std::vector<Vec3d> places_of(const SceneOutline& scene) {
  std::vector<Vec3d> places;
  places.reserve(scene.points.size());
  for (const ScenePoint& point : scene.points)
    places.push_back(Vec3d(point.position) + scene.world_offset);
  return places;
}

Vec3d up_of(const SceneOutline& scene) {
  std::vector<Vec3f> points;
  points.reserve(scene.points.size());
  for (const ScenePoint& point : scene.points) points.push_back(point.position);
  return scene_frame(scene.cameras, {points.data(), points.size()}).up;
}

// The planes around a part, moved outwards.
std::vector<WideHalfSpace> region_of_part(const CutTree& tree, std::size_t part,
                                          const std::vector<Vec3d>& points_of_part, double border) {
  std::vector<WideHalfSpace> region = tree.bounds_of(part);
  for (WideHalfSpace& bound : region)
    bound.offset -= border * reach_along(bound.normal, points_of_part);
  return region;
}

/// Which points are in the regions of which blocks.
class Census {
 public:
  Census(const SceneOutline& scene, const Partition& partition, const std::vector<Vec3d>& places)
      : scene_(scene), partition_(partition) {
    for (const Block& block : partition.blocks) {
      is_inside_.emplace_back();
      for (const Vec3d& place : places) is_inside_.back().push_back(block.holds(place));
    }
  }

  bool is_inside(std::size_t block, std::size_t point) const { return is_inside_[block][point]; }

  /// The share of each block in the points of a view. A view without points has all of them in the
  /// block in which its camera stands.
  std::vector<double> shares_of(std::size_t view) const {
    const std::vector<std::uint32_t>& shown = scene_.shown[view];
    std::vector<double> shares(partition_.blocks.size(), 0);
    for (std::size_t b = 0; b < shares.size(); ++b)
      for (const std::uint32_t point : shown)
        shares[b] += is_inside(b, point) ? 1 / double(shown.size()) : 0;
    if (shown.empty()) {
      const Vec3d center = Vec3d(scene_.cameras[view].position()) + scene_.world_offset;
      shares[partition_.tree.part_of(center)] = 1;
    }
    return shares;
  }

 private:
  const SceneOutline& scene_;
  const Partition& partition_;
  std::vector<std::vector<bool>> is_inside_;  // (blocks, points)
};

// Adds the view to the blocks that it shows.
void deal_view(const SceneOutline& scene, std::size_t view, const std::vector<double>& of_points,
               const std::vector<double>& of_picture, double least_share,
               std::vector<std::vector<bool>>& views_of_blocks, Partition& partition) {
  const auto most = std::size_t(std::ranges::max_element(of_points) - of_points.begin());
  for (std::size_t b = 0; b < of_points.size(); ++b) {
    const double share = of_picture.empty() ? of_points[b] : std::max(of_points[b], of_picture[b]);
    if (b != most && share < least_share) continue;
    Block& block = partition.blocks[b];
    views_of_blocks[b][view] = true;
    block.photos.push_back(scene.names[view]);
    ++(scene.is_test[view] ? block.test_photos : block.train_photos);
  }
}

void count_points(const SceneOutline& scene, const Census& census,
                  const std::vector<std::vector<bool>>& views_of_blocks, Partition& partition) {
  for (std::size_t b = 0; b < partition.blocks.size(); ++b) {
    Block& block = partition.blocks[b];
    std::vector<bool> is_shown(scene.points.size(), false);
    for (std::size_t view = 0; view < scene.shown.size(); ++view)
      if (views_of_blocks[b][view])
        for (const std::uint32_t point : scene.shown[view]) is_shown[point] = true;
    for (std::size_t p = 0; p < is_shown.size(); ++p) {
      if (!is_shown[p]) continue;
      ++block.points;
      block.points_outside += !census.is_inside(b, p);
    }
    block.start = block.points;
    block.start_outside = block.points_outside;
  }
}

void check_blocks(const Partition& partition) {
  for (std::size_t b = 0; b < partition.blocks.size(); ++b) {
    const Block& block = partition.blocks[b];
    const bool has_points = block.points > block.points_outside;
    if (block.train_photos > 0 && has_points) continue;
    throw UsageError(
        fmt::format("the scene cannot be divided into {} blocks: {} would be left for block {}; "
                    "give fewer with --blocks",
                    partition.blocks.size(),
                    has_points ? "no photo to train on" : "no sparse point that a photo shows", b));
  }
}

}  // namespace

bool Block::holds(const Vec3d& place) const {
  return std::ranges::all_of(region, [&](const WideHalfSpace& half) { return half.holds(place); });
}

Partition make_partition(const SceneOutline& scene, const PartitionOptions& options,
                         const SharesInView& in_picture) {
  if (scene.points.empty())
    throw Error(
        "the scene has no sparse points, and a partition is made by what photos show of them; run "
        "COLMAP's point_triangulator, or train the scene as one");
  const std::vector<Vec3d> places = places_of(scene);
  Partition partition;
  partition.up = up_of(scene);
  partition.points = places.size();
  partition.tree = divide(places, ground_axes(partition.up, places), options.blocks);
  std::vector<std::vector<Vec3d>> of_parts(options.blocks);
  for (const Vec3d& place : places) of_parts[partition.tree.part_of(place)].push_back(place);
  partition.blocks.resize(options.blocks);
  for (std::size_t b = 0; b < options.blocks; ++b)
    partition.blocks[b].region = region_of_part(partition.tree, b, of_parts[b], options.border);

  const Census census(scene, partition, places);
  const std::vector<bool> none(scene.names.size(), false);
  std::vector<std::vector<bool>> views_of_blocks(options.blocks, none);
  for (std::size_t view = 0; view < scene.names.size(); ++view)
    deal_view(scene, view, census.shares_of(view),
              in_picture ? in_picture(view, partition.blocks) : std::vector<double>(),
              options.least_share, views_of_blocks, partition);
  count_points(scene, census, views_of_blocks, partition);
  check_blocks(partition);
  return partition;
}

}  // namespace gs
