// SPDX-License-Identifier: Apache-2.0
#include "gs_render/fusion/volume.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/projection.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr int kSampledPixels = 7;           // every so many-th along rows and columns
constexpr std::size_t kOutlierPercent = 1;  // of the points, at either end of an axis
// Of a closed surface, views before which a voxel is hidden, for each one that sees it: fewer are rays
// that slip through gaps, and would dig tunnels.
constexpr int kHiddenPerView = 8;
constexpr float kMarginShare = 0.05f;  // of the box, on each side
// Bytes of a block until the mesh is written, with the triangles that it has in the mean; of a closed
// volume, which has others around it.
constexpr double kBlockBytes = 6000, kClosedBlockBytes = 15000;

Vec3f point_at(const Camera& camera, int x, int y, float o) {
  const Vec3f p((float(x) + 0.5f - camera.cx) / (camera.fx * o),
                (float(y) + 0.5f - camera.cy) / (camera.fy * o), 1 / o);
  return multiply_transposed(camera.cam_from_world_rotation, p - camera.cam_from_world_translation);
}

/// Calls visit(camera, x, y, o) for every `step`-th pixel with a surface, both ways.
template <class Visit>
void for_surface_pixels(const std::vector<DepthView>& views, int step, Visit&& visit) {
  for (const DepthView& view : views)
    for (int y = step / 2; y < view.camera.height; y += step)
      for (int x = step / 2; x < view.camera.width; x += step)
        if (const float o = view.inverse_depth.at(x, y, 0); o > 0) visit(view.camera, x, y, o);
}

void sort_and_merge(std::vector<std::uint64_t>& keys) {
  std::sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
}

/// What one voxel hears from all views.
struct Votes {
  float sum = 0, weight = 0;
  int near = 0, free = 0, hidden = 0;  // views

  void add(const DepthView& view, const Vec3f& p, float truncation) {
    const Vec3f c = to_camera(view.camera, p);
    if (!(c.z > 0)) return;
    const Vec2f at = project_mean(view.camera, c);
    if (!(at.x >= 0 && at.x < float(view.camera.width) && at.y >= 0 &&
          at.y < float(view.camera.height)))
      return;
    const float o = view.inverse_depth_at(at.x, at.y);
    if (o < 0) ++free;
    if (!(o > 0)) return;
    const float facing = view.facing_at(int(at.x), int(at.y));
    const float d = (1 / o - c.z) * facing * length(c) / c.z;
    if (d <= -truncation) {
      ++hidden;
      return;
    }
    ++(d > truncation ? free : near);
    const float share = std::min(d / truncation, 1.0f);
    const float g = facing * facing * o * o * std::min(1 + share, 1.0f);
    sum += g * share;
    weight += g;
  }
  /// The voxel's distance. `least`: views that must agree.
  float distance(int least, bool is_watertight) const {
    if (is_watertight) least = std::max(least, hidden / kHiddenPerView);
    if (near + free < least) return !is_watertight ? std::nanf("") : hidden > 0 ? -1.0f : 1.0f;
    if (!(weight > 0) || free >= 3 + 3 * near) return 1;
    return sum / weight;
  }
};

/// A block's sphere against a view's pyramid.
bool sees_sphere(const Camera& camera, const Vec3f& center, float radius) {
  const Vec3f c = to_camera(camera, center);
  const auto is_inside = [&](float x, float f, float edge) {  // f x + edge z >= 0 inside
    return f * x + edge * c.z >= -radius * std::sqrt(f * f + edge * edge);
  };
  return c.z > -radius && is_inside(c.x, camera.fx, camera.cx) &&
         is_inside(-c.x, camera.fx, float(camera.width) - camera.cx) &&
         is_inside(c.y, camera.fy, camera.cy) &&
         is_inside(-c.y, camera.fy, float(camera.height) - camera.cy);
}

/// Fills volumes, block by block.
class Fusion {
 public:
  Fusion(const std::vector<DepthView>& views, const VolumeFrame& frame, const FusionRule& rule)
      : views_(views), frame_(frame), rule_(rule),
        least_(int(std::min<std::size_t>(2, views.size()))) {}

  void fill_block(std::uint64_t key, float* distance) const {
    const Vec3f low = corner(key);
    const float half = 0.5f * float(kBlockEdge - 1) * frame_.voxel;
    std::vector<const DepthView*> seeing;
    for (const DepthView& view : views_)
      if (sees_sphere(view.camera, low + Vec3f(half), half * std::sqrt(3.0f)))
        seeing.push_back(&view);
    for (int v = 0; v < kBlockVoxels; ++v) {
      const Vec3f step(float(v % kBlockEdge), float(v / kBlockEdge % kBlockEdge),
                       float(v / (kBlockEdge * kBlockEdge)));
      distance[v] = distance_at(low + frame_.voxel * step, seeing);
    }
  }
  bool is_border(std::uint64_t key) const {
    for (int axis = 0; axis < 3; ++axis)
      if (const std::uint64_t at = frame_.place(key, axis);
          at == 0 || at + 1 == frame_.blocks[axis])
        return true;
    return false;
  }
  /// That of a block's first voxel.
  float first_distance(std::uint64_t key) const {
    if (is_border(key)) return 1;
    std::vector<const DepthView*> all;
    for (const DepthView& view : views_) all.push_back(&view);
    return distance_at(corner(key), all);
  }

 private:
  Vec3f corner(std::uint64_t key) const {
    Vec3f low = frame_.low;
    for (int axis = 0; axis < 3; ++axis)
      low[axis] += frame_.voxel * float(kBlockEdge * frame_.place(key, axis));
    return low;
  }
  float distance_at(const Vec3f& p, const std::vector<const DepthView*>& seeing) const {
    Votes votes;
    for (const DepthView* view : seeing) votes.add(*view, p, rule_.truncation * frame_.voxel);
    return votes.distance(least_, rule_.is_watertight);
  }

  const std::vector<DepthView>& views_;
  const VolumeFrame& frame_;
  const FusionRule& rule_;
  int least_;
};

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

float median_pixel(const std::vector<DepthView>& views) {
  std::vector<float> sizes;
  for_surface_pixels(views, kSampledPixels, [&](const Camera& camera, int, int, float o) {
    sizes.push_back(1 / (o * camera.fx));
  });
  if (sizes.empty()) return 0;
  const auto middle = sizes.begin() + std::ptrdiff_t(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  return *middle;
}

VolumeFrame volume_frame(const std::vector<DepthView>& views, float voxel, const FusionRule& rule) {
  std::vector<float> at[3];
  for_surface_pixels(views, kSampledPixels, [&](const Camera& camera, int x, int y, float o) {
    const Vec3f p = point_at(camera, x, y, o);
    for (int axis = 0; axis < 3; ++axis) at[axis].push_back(p[axis]);
  });
  VolumeFrame frame;
  frame.voxel = voxel;
  const float block = kBlockEdge * voxel;
  for (int axis = 0; axis < 3; ++axis) {
    std::sort(at[axis].begin(), at[axis].end());
    const std::size_t out = at[axis].size() * kOutlierPercent / 100;
    const float low = at[axis][out], high = at[axis][at[axis].size() - 1 - out];
    const float margin = kMarginShare * (high - low) + rule.truncation * voxel;
    frame.blocks[axis] = std::uint64_t(std::ceil((high - low + 2 * margin) / block)) + 2;
    frame.low[axis] = low - margin - block;  // one block of air on each side
  }
  return frame;
}

std::vector<std::uint64_t> surface_blocks(const std::vector<DepthView>& views,
                                          const VolumeFrame& frame, const FusionRule& rule) {
  std::vector<std::uint64_t> blocks, merged;
  const float reach = rule.truncation / kBlockEdge;  // blocks
  for (const DepthView& view : views) {
    std::vector<std::vector<std::uint64_t>> rows(std::size_t(view.camera.height));
    parallel_for(rows.size(), 8, [&](std::size_t y) {
      std::vector<std::uint64_t>& keys = rows[y];
      for (int x = 0; x < view.camera.width; ++x) {
        const float o = view.inverse_depth.at(x, int(y), 0);
        if (!(o > 0)) continue;
        const Vec3f p =
            (point_at(view.camera, x, int(y), o) - frame.low) / (kBlockEdge * frame.voxel);
        std::int64_t first[3], last[3];
        for (int axis = 0; axis < 3; ++axis) {
          first[axis] = std::max<std::int64_t>(1, std::int64_t(std::floor(p[axis] - reach)));
          last[axis] = std::min(std::int64_t(frame.blocks[axis]) - 2,
                                std::int64_t(std::floor(p[axis] + reach)));
        }
        for (std::int64_t k = first[2]; k <= last[2]; ++k)
          for (std::int64_t j = first[1]; j <= last[1]; ++j)
            for (std::int64_t i = first[0]; i <= last[0]; ++i)
              keys.push_back(frame.key(std::uint64_t(i), std::uint64_t(j), std::uint64_t(k)));
      }
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

VolumeForecast forecast_volume(const std::vector<DepthView>& views, float voxel,
                               const FusionRule& rule) {
  const float counted = std::max(voxel, median_pixel(views));
  const VolumeFrame frame = volume_frame(views, counted, rule);
  return {counted, double(surface_blocks(views, frame, rule).size()),
          rule.is_watertight ? double(frame.count()) : 0};
}

Volume fuse(const std::vector<DepthView>& views, const VolumeFrame& frame,
            std::vector<std::uint64_t> blocks, const FusionRule& rule,
            const FusionProgress& progress) {
  const Fusion fusion(views, frame, rule);
  Volume volume{frame, std::move(blocks), {}};
  std::vector<std::uint64_t> filled;
  std::vector<char> is_air;
  if (rule.is_watertight) {
    is_air.resize(frame.count());
    parallel_for(is_air.size(), 256,
                 [&](std::size_t key) { is_air[key] = fusion.first_distance(key) >= 0; });
    filled = closed_blocks(frame, std::move(volume.keys), is_air);
    // A block around these has one sign, as have all blocks behind it, so that the surface ends here.
    for (const std::uint64_t key : filled)
      for_blocks_beside(frame, key, -1, [&](std::uint64_t other) { volume.keys.push_back(other); });
    sort_and_merge(volume.keys);
  }
  volume.distance.resize(volume.keys.size() * kBlockVoxels);
  constexpr std::size_t kPart = 4096;  // blocks between two reports
  for (std::size_t begin = 0; begin < volume.keys.size(); begin += kPart) {
    const std::size_t end = std::min(begin + kPart, volume.keys.size());
    parallel_for(end - begin, 4, [&](std::size_t i) {
      const std::uint64_t key = volume.keys[begin + i];
      float* const distance = &volume.distance[(begin + i) * kBlockVoxels];
      if (!rule.is_watertight ||
          (!fusion.is_border(key) && std::binary_search(filled.begin(), filled.end(), key)))
        fusion.fill_block(key, distance);
      else
        std::fill_n(distance, kBlockVoxels, is_air[key] ? 1.0f : -1.0f);
    });
    if (progress) progress(end, volume.keys.size());
  }
  return volume;
}

}  // namespace gs
