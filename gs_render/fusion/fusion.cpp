// SPDX-License-Identifier: Apache-2.0
#include "gs_render/fusion/fusion.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "gs_core/threads/parallel.h"
#include "gs_render/fusion/agreement.h"
#include "gs_render/fusion/surface_depth.h"
#include "gs_render/fusion/votes.h"
#include "gs_render/renderer.h"

namespace gs {
namespace {

constexpr int kSampledPixels = 7;           // every so many-th along rows and columns
constexpr std::size_t kOutlierPercent = 1;  // of the points, at either end of an axis
constexpr float kMarginShare = 0.05f;       // of the box, on each side
// Bytes of a block until the mesh is written, with the triangles that it has in the mean; of a closed
// volume, which has others around it.
constexpr double kBlockBytes = 6000, kClosedBlockBytes = 15000;

/// Calls visit(picture, x, y) for every kSampledPixels-th pixel with a surface, both ways.
template <class Visit>
void for_sampled_pixels(const std::vector<DepthView>& views, Visit&& visit) {
  for (const DepthView& view : views) {
    const DepthPicture picture = view.picture();
    for (int y = kSampledPixels / 2; y < view.camera.height; y += kSampledPixels)
      for (int x = kSampledPixels / 2; x < view.camera.width; x += kSampledPixels)
        if (picture.has(x, y)) visit(picture, x, y);
  }
}

void sort_and_merge(std::vector<std::uint64_t>& keys) {
  std::sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
}

/// The value at a place of the sorted values.
float value_at(std::vector<float>& values, std::size_t place) {
  const auto at = values.begin() + std::ptrdiff_t(place);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// The blocks beside a block, itself included, that are in the frame: for offsets from `first` to 1
/// along each axis.
template <class Visit>
void for_blocks_beside(const VolumeFrame& frame, std::uint64_t key, int first, Visit&& visit) {
  std::int64_t at[3];
  for (int axis = 0; axis < 3; ++axis) at[axis] = std::int64_t(frame.place(key, axis));
  const auto is_in = [&](int axis, std::int64_t a) {
    return a >= 0 && a < std::int64_t(frame.blocks[axis]);
  };
  for (std::int64_t z = at[2] + first; z <= at[2] + 1; ++z)
    for (std::int64_t y = at[1] + first; y <= at[1] + 1; ++y)
      for (std::int64_t x = at[0] + first; x <= at[0] + 1; ++x)
        if (is_in(0, x) && is_in(1, y) && is_in(2, z))
          visit(frame.key(std::uint64_t(x), std::uint64_t(y), std::uint64_t(z)));
}

/// The blocks of a closed surface: those near surfaces, and those whose first voxels, and the first
/// ones behind them, are not all solid or all air. `is_air` has the first voxels of all blocks.
std::vector<std::uint64_t> closed_blocks(const VolumeFrame& frame,
                                         std::vector<std::uint64_t> blocks,
                                         const std::vector<char>& is_air) {
  for (std::uint64_t key = 0; key < frame.count(); ++key) {
    bool is_mixed = false;
    for_blocks_beside(frame, key, 0,
                      [&](std::uint64_t other) { is_mixed |= is_air[other] != is_air[key]; });
    if (is_mixed) blocks.push_back(key);
  }
  sort_and_merge(blocks);
  return blocks;
}

}  // namespace

void Fusion::add(const GaussiansSpan& gaussians, const Camera& camera,
                 const RenderSettings& settings, const RenderPass& pass, Image8 color) {
  add(depth_view(camera, surface_inverse_depth(pass, gaussians, camera, settings),
                 std::move(color)));
}

void Fusion::drop_doubtful() {
  if (views_.size() < 2) return;
  std::vector<DepthPicture> pictures;
  for (const DepthView& view : views_) pictures.push_back(view.picture());
  std::vector<std::vector<char>> doubtful(views_.size());
  for (std::size_t v = 0; v < views_.size(); ++v) {
    const Camera& camera = views_[v].camera;
    doubtful[v].resize(views_[v].inverse_depth.pixels.size());
    parallel_for(std::size_t(camera.height), 4, [&](std::size_t y) {
      for (int x = 0; x < camera.width; ++x)
        doubtful[v][pictures[v].pixel(x, int(y))] =
            is_doubtful({pictures.data(), pictures.size()}, v, x, int(y));
    });
  }
  for (std::size_t v = 0; v < views_.size(); ++v)
    for (std::size_t i = 0; i < doubtful[v].size(); ++i)
      if (doubtful[v][i]) views_[v].inverse_depth.pixels[i] = kUnknownDepth;
}

float Fusion::median_pixel() const {
  std::vector<float> sizes;
  for_sampled_pixels(views_, [&](const DepthPicture& picture, int x, int y) {
    sizes.push_back(1 / (picture.inverse_depth[picture.pixel(x, y)] * picture.camera.fx));
  });
  return sizes.empty() ? 0 : value_at(sizes, sizes.size() / 2);
}

VolumeFrame Fusion::frame(float voxel) const {
  std::vector<float> at[3];
  for_sampled_pixels(views_, [&](const DepthPicture& picture, int x, int y) {
    const Vec3f p = picture.world_point(x, y);
    for (int axis = 0; axis < 3; ++axis) at[axis].push_back(p[axis]);
  });
  VolumeFrame frame;
  frame.voxel = voxel;
  const float block = kBlockEdge * voxel;
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t out = at[axis].size() * kOutlierPercent / 100;
    const float low = value_at(at[axis], out), high = value_at(at[axis], at[axis].size() - 1 - out);
    const float margin = kMarginShare * (high - low) + rule_.truncation * voxel;
    frame.blocks[axis] = std::uint64_t(std::ceil((high - low + 2 * margin) / block)) + 2;
    frame.low[axis] = low - margin - block;  // one block of air on each side
  }
  return frame;
}

std::vector<std::uint64_t> Fusion::surface_blocks(const VolumeFrame& frame) {
  std::vector<std::uint64_t> blocks, merged;
  for (const DepthView& view : views_) {
    const DepthPicture picture = view.picture();
    std::vector<std::vector<std::uint64_t>> rows(std::size_t(view.camera.height));
    parallel_for(rows.size(), 8, [&](std::size_t y) {
      std::vector<std::uint64_t>& keys = rows[y];
      for (int x = 0; x < view.camera.width; ++x)
        if (picture.has(x, int(y)))
          for_blocks_near(frame, rule_, picture.world_point(x, int(y)),
                          [&](auto... place) { keys.push_back(frame.key(place...)); });
      sort_and_merge(keys);
    });
    std::vector<std::uint64_t> seen;
    for (const auto& keys : rows) seen.insert(seen.end(), keys.begin(), keys.end());
    sort_and_merge(seen);
    merged.clear();
    std::set_union(blocks.begin(), blocks.end(), seen.begin(), seen.end(),
                   std::back_inserter(merged));
    blocks.swap(merged);
  }
  return blocks;
}

double VolumeForecast::bytes_at(double size) const {
  const double finer = voxel / size;
  return blocks * finer * finer * (lattice > 0 ? kClosedBlockBytes : kBlockBytes) +
         lattice * finer * finer * finer;
}

VolumeForecast Fusion::forecast(float voxel) {
  const float counted = std::max(voxel, median_pixel());
  const VolumeFrame counted_frame = frame(counted);
  return {counted, double(surface_blocks(counted_frame).size()),
          rule_.is_watertight ? double(counted_frame.count()) : 0};
}

std::vector<char> Fusion::air_at_corners(const VolumeFrame& frame) {
  std::vector<char> is_air(frame.count(), 1);
  parallel_for(is_air.size(), 256, [&](std::size_t key) {
    if (frame.is_border(key)) return;
    Votes votes;
    for (const DepthView& view : views_)
      votes.add(view.picture(), frame.corner(key), rule_.truncation * frame.voxel);
    is_air[key] = votes.distance(least_views(), rule_.is_watertight) >= 0;
  });
  return is_air;
}

void Fusion::fill(const VolumeFrame& frame, Span<const std::uint64_t> keys,
                  Span<const BlockKind> kinds, float* distance) {
  parallel_for(keys.size, 4, [&](std::size_t block) {
    float* const to = distance + block * kBlockVoxels;
    if (kinds[block] != BlockKind::mixed) {
      std::fill_n(to, kBlockVoxels, float(kinds[block]));
      return;
    }
    const Vec3f corner = frame.corner(keys[block]);
    std::vector<DepthPicture> seeing;
    for (const DepthView& view : views_)
      if (sees_block(view.camera, frame, corner)) seeing.push_back(view.picture());
    for (int v = 0; v < kBlockVoxels; ++v) {
      Votes votes;
      for (const DepthPicture& picture : seeing)
        votes.add(picture, frame.voxel_at(corner, v), rule_.truncation * frame.voxel);
      to[v] = votes.distance(least_views(), rule_.is_watertight);
    }
  });
}

Volume Fusion::fuse(const VolumeFrame& frame, const FusionProgress& progress) {
  Volume volume{frame, surface_blocks(frame), {}};
  std::vector<BlockKind> kinds(volume.keys.size(), BlockKind::mixed);
  if (rule_.is_watertight) {
    const std::vector<char> is_air = air_at_corners(frame);
    const std::vector<std::uint64_t> mixed = closed_blocks(frame, std::move(volume.keys), is_air);
    // A block around these has one sign, as have all blocks behind it, so that the surface ends here.
    volume.keys.clear();
    for (const std::uint64_t key : mixed)
      for_blocks_beside(frame, key, -1, [&](std::uint64_t other) { volume.keys.push_back(other); });
    sort_and_merge(volume.keys);
    kinds.resize(volume.keys.size());
    std::transform(volume.keys.begin(), volume.keys.end(), kinds.begin(), [&](std::uint64_t key) {
      if (!frame.is_border(key) && std::binary_search(mixed.begin(), mixed.end(), key))
        return BlockKind::mixed;
      return is_air[key] ? BlockKind::air : BlockKind::solid;
    });
  }
  volume.distance.resize(volume.keys.size() * kBlockVoxels);
  constexpr std::size_t kPart = 4096;  // blocks between two reports
  for (std::size_t begin = 0; begin < volume.keys.size(); begin += kPart) {
    const std::size_t count = std::min(kPart, volume.keys.size() - begin);
    fill(frame, {&volume.keys[begin], count}, {&kinds[begin], count},
         &volume.distance[begin * kBlockVoxels]);
    if (progress) progress(begin + count, volume.keys.size());
  }
  return volume;
}

std::unique_ptr<Fusion> Renderer::fusion(const FusionRule& rule) {
  return std::make_unique<Fusion>(rule);
}

}  // namespace gs
