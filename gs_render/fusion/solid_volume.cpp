// SPDX-License-Identifier: Apache-2.0
#include "gs_render/fusion/solid_volume.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/ellipsoid.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr float kLeastOpacity = 0.1f;       // of Gaussians that the box counts
constexpr float kLeastAlpha = 1.0f / 64;    // of a Gaussian at a voxel; less is left out
constexpr float kMostAlpha = 0.99f;         // so that sums of logarithms stay finite
constexpr std::size_t kOutlierPercent = 1;  // of the means, at either end of an axis
constexpr float kMarginShare = 0.05f;       // of the box, on each side
constexpr float kUsualVoxels = 128;         // along the longest side

using Place = std::array<int, 3>;  // of a voxel of the frame

/// The voxels of a frame with all blocks.
class Lattice {
 public:
  explicit Lattice(const VolumeFrame& frame) : frame_(frame) {}

  int size(int axis) const { return kBlockEdge * int(frame_.blocks[axis]); }
  /// A voxel's number in Volume::distance.
  std::size_t index(const Place& at) const {
    const auto block = [&](int axis) { return std::uint64_t(at[std::size_t(axis)] / kBlockEdge); };
    const Place in{at[0] % kBlockEdge, at[1] % kBlockEdge, at[2] % kBlockEdge};
    return frame_.key(block(0), block(1), block(2)) * kBlockVoxels +
           std::size_t((in[2] * kBlockEdge + in[1]) * kBlockEdge + in[0]);
  }
  /// Whether a voxel lies in one of the outermost blocks, which stay air.
  bool is_border(const Place& at) const {
    for (int axis = 0; axis < 3; ++axis)
      if (at[std::size_t(axis)] < kBlockEdge || at[std::size_t(axis)] >= size(axis) - kBlockEdge)
        return true;
    return false;
  }
  /// Calls visit(place) for all voxels but those of the outermost blocks.
  template <class Visit>
  void for_inner(Visit&& visit) const {
    for (int z = kBlockEdge; z < size(2) - kBlockEdge; ++z)
      for (int y = kBlockEdge; y < size(1) - kBlockEdge; ++y)
        for (int x = kBlockEdge; x < size(0) - kBlockEdge; ++x) visit(Place{x, y, z});
  }

 private:
  const VolumeFrame& frame_;
};

/// A Gaussian as voxels see it.
struct SolidGaussian {
  Vec3f mean, reach;       // world units: where it ends along each axis
  Sym3<double> precision;  // of the widened covariance
  float opacity;

  float alpha_at(const Vec3f& x) const {
    const Vec3d d(x - mean);
    return min_of(opacity * std::exp(float(-0.5 * inner(d, multiply(precision, d)))), kMostAlpha);
  }
};

Ellipsoid ellipsoid_of(const Gaussians& g, std::size_t i) {
  return ellipsoid_of(g.mean[i], g.log_scale[i], g.rotation[i], g.logit_opacity[i],
                      g.has_filter ? g.filter_scale[i] : 0.0f);
}

std::vector<SolidGaussian> solid_gaussians(const Gaussians& gaussians, float voxel) {
  std::vector<SolidGaussian> all;
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    const Ellipsoid ellipsoid = ellipsoid_of(gaussians, i);
    if (!(ellipsoid.opacity > kLeastAlpha)) continue;
    const Sym3<float>& s = ellipsoid.sigma;
    const double wider = 0.25 * double(voxel) * double(voxel);
    const Sym3<double> sigma{s.xx + wider, s.xy, s.xz, s.yy + wider, s.yz, s.zz + wider};
    const Vec3d x = solve(sigma, Vec3d(1, 0, 0)), y = solve(sigma, Vec3d(0, 1, 0)),
                z = solve(sigma, Vec3d(0, 0, 1));
    const double reach = std::sqrt(2 * std::log(double(ellipsoid.opacity / kLeastAlpha)));
    all.push_back(
        {ellipsoid.mean,
         Vec3f(reach * Vec3d(std::sqrt(sigma.xx), std::sqrt(sigma.yy), std::sqrt(sigma.zz))),
         {x.x, x.y, x.z, y.y, y.z, z.z},
         ellipsoid.opacity});
  }
  return all;
}

/// The voxels within the reach of a Gaussian along an axis: first, and one behind the last.
std::array<int, 2> range_of(const SolidGaussian& gaussian, const VolumeFrame& frame, int axis,
                            int low, int high) {
  const float at = (gaussian.mean[axis] - frame.low[axis]) / frame.voxel;
  const float reach = gaussian.reach[axis] / frame.voxel;
  return {int(clamp_to(std::ceil(at - reach), float(low), float(high))),
          int(clamp_to(std::floor(at + reach) + 1, float(low), float(high)))};
}

/// Adds -log(1 - alpha) of all Gaussians to the voxels, each layer of blocks by itself.
void add_gaussians(const std::vector<SolidGaussian>& gaussians, const VolumeFrame& frame,
                   std::vector<float>& sums) {
  const Lattice lattice(frame);
  const auto inner_range = [&](const SolidGaussian& gaussian, int axis) {
    return range_of(gaussian, frame, axis, kBlockEdge, lattice.size(axis) - kBlockEdge);
  };
  std::vector<std::vector<std::uint32_t>> of_layer(frame.blocks[2]);
  for (std::uint32_t i = 0; i < gaussians.size(); ++i) {
    const auto [first, end] = inner_range(gaussians[i], 2);
    for (int layer = first / kBlockEdge; first < end && layer <= (end - 1) / kBlockEdge; ++layer)
      of_layer[std::size_t(layer)].push_back(i);
  }
  parallel_for(of_layer.size(), 1, [&](std::size_t layer) {
    const int begin_z = kBlockEdge * int(layer);
    for (const std::uint32_t i : of_layer[layer]) {
      const SolidGaussian& gaussian = gaussians[i];
      const auto x_range = inner_range(gaussian, 0), y_range = inner_range(gaussian, 1),
                 z_range = range_of(gaussian, frame, 2, begin_z, begin_z + kBlockEdge);
      for (int z = z_range[0]; z < z_range[1]; ++z)
        for (int y = y_range[0]; y < y_range[1]; ++y)
          for (int x = x_range[0]; x < x_range[1]; ++x)
            if (const float alpha = gaussian.alpha_at(
                    frame.low + frame.voxel * Vec3f(float(x), float(y), float(z)));
                alpha >= kLeastAlpha)
              sums[lattice.index({x, y, z})] -= std::log1p(-alpha);
    }
  });
}

/// Which air a way through air leads to from a voxel, past the faces of voxels.
std::vector<char> reached_from(const Place& start, const Lattice& lattice,
                               const std::vector<float>& distance) {
  std::vector<char> is_reached(distance.size(), 0);
  std::vector<Place> open{start};
  is_reached[lattice.index(start)] = 1;
  while (!open.empty()) {
    const Place at = open.back();
    open.pop_back();
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (const int step : {-1, 1}) {
        Place next = at;
        next[axis] += step;
        if (next[axis] < 0 || next[axis] >= lattice.size(int(axis))) continue;
        const std::size_t index = lattice.index(next);
        if (is_reached[index] || distance[index] < 0) continue;
        is_reached[index] = 1;
        open.push_back(next);
      }
  }
  return is_reached;
}

/// The voxel of air that is nearest to the middle of the frame, in voxels along the axes.
Place middle_air(const Lattice& lattice, const std::vector<float>& distance) {
  const Place middle{lattice.size(0) / 2, lattice.size(1) / 2, lattice.size(2) / 2};
  Place best{0, 0, 0};
  std::int64_t least = std::numeric_limits<std::int64_t>::max();
  lattice.for_inner([&](const Place& at) {
    std::int64_t square = 0;
    for (std::size_t axis = 0; axis < 3; ++axis)
      square += std::int64_t(at[axis] - middle[axis]) * (at[axis] - middle[axis]);
    if (square < least && distance[lattice.index(at)] >= 0) least = square, best = at;
  });
  return best;
}

void fill_floor(const Lattice& lattice, std::vector<float>& distance) {
  for (int z = kBlockEdge; z < lattice.size(2) - kBlockEdge; ++z)
    for (int x = kBlockEdge; x < lattice.size(0) - kBlockEdge; ++x) {
      int lowest = lattice.size(1) - 1 - kBlockEdge;
      while (lowest >= kBlockEdge && distance[lattice.index({x, lowest, z})] >= 0) --lowest;
      if (lowest < kBlockEdge) continue;  // nothing is there
      for (int y = lowest + 1; y < lattice.size(1) - kBlockEdge; ++y)
        distance[lattice.index({x, y, z})] = -1;
    }
}

}  // namespace

VolumeFrame solid_frame(const Gaussians& gaussians, float voxel) {
  std::vector<float> at[3];
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    const Ellipsoid ellipsoid = ellipsoid_of(gaussians, i);
    if (!(ellipsoid.opacity >= kLeastOpacity)) continue;
    for (int axis = 0; axis < 3; ++axis) at[axis].push_back(ellipsoid.mean[axis]);
  }
  if (at[0].empty())
    throw Error("no Gaussian of the model is a tenth opaque, so that nothing of it is solid");
  VolumeFrame frame;
  Vec3f low, size;
  for (int axis = 0; axis < 3; ++axis) {
    std::sort(at[axis].begin(), at[axis].end());
    const std::size_t out = at[axis].size() * kOutlierPercent / 100;
    low[axis] = at[axis][out];
    size[axis] = at[axis][at[axis].size() - 1 - out] - low[axis];
  }
  const float longest = std::max({size.x, size.y, size.z});
  frame.voxel = voxel > 0 ? voxel : std::max(longest, 1e-6f) / kUsualVoxels;
  const float block = kBlockEdge * frame.voxel;
  for (int axis = 0; axis < 3; ++axis) {
    const float margin = kMarginShare * longest + frame.voxel;
    frame.blocks[axis] = std::uint64_t(std::ceil((size[axis] + 2 * margin) / block)) + 2;
    frame.low[axis] = low[axis] - margin - block;
  }
  return frame;
}

Volume solid_volume(const Gaussians& gaussians, const VolumeFrame& frame, SolidFill fill) {
  Volume volume{frame, std::vector<std::uint64_t>(frame.count()), {}};
  for (std::size_t key = 0; key < volume.keys.size(); ++key) volume.keys[key] = key;
  std::vector<float>& distance = volume.distance;
  distance.resize(frame.count() * kBlockVoxels, 0);
  add_gaussians(solid_gaussians(gaussians, frame.voxel), frame, distance);
  parallel_chunks(distance.size(), 65536, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) distance[i] = 2 * std::exp(-distance[i]) - 1;
  });
  const Lattice lattice(frame);
  if (fill == SolidFill::floor) {
    fill_floor(lattice, distance);
    return volume;
  }
  const Place start = fill == SolidFill::inside ? Place{0, 0, 0} : middle_air(lattice, distance);
  const std::vector<char> is_reached = reached_from(start, lattice, distance);
  if (fill == SolidFill::outside && is_reached[lattice.index({0, 0, 0})])
    throw Error(
        "a way leads from the middle of the model to its outside, so that it is no closed room; "
        "give --collision floor, or a larger --voxel where walls have gaps");
  lattice.for_inner([&](const Place& at) {
    const std::size_t index = lattice.index(at);
    if (!is_reached[index] && distance[index] >= 0) distance[index] = -1;
  });
  return volume;
}

}  // namespace gs
