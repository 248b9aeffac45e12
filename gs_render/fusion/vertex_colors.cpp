// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "gs_core/threads/parallel.h"
#include "gs_render/fusion/marching_cubes.h"

namespace gs {
namespace {

constexpr std::size_t kColoringViews = 4;
constexpr float kVisibleVoxels = 2;  // depth between a vertex and what its pixel shows
constexpr Rgb8 kUnseenColor = {128, 128, 128};

/// One view's say about the color of a vertex.
struct ColorSample {
  float weight = 0;
  const std::uint8_t* color = nullptr;
};

ColorSample sample_of(const DepthView& view, const Vec3f& p, float voxel) {
  const DepthPicture picture = view.picture();
  const Vec3f c = to_camera(view.camera, p);
  Vec2f at;
  if (!picture.contains(c, at)) return {};
  const float o = picture.inverse_depth_at(at);
  if (!(o > 0) || std::abs(1 / o - c.z) > kVisibleVoxels * voxel) return {};
  const float facing = picture.facing_at(int(at.x), int(at.y));
  return {facing * facing * o * o, &view.color.at(int(at.x), int(at.y), 0)};
}

}  // namespace

std::vector<char> color_vertices(const std::vector<DepthView>& views, float voxel,
                                 TriangleMesh& mesh) {
  mesh.colors.assign(mesh.vertices.size(), kUnseenColor);
  std::vector<char> is_seen(mesh.vertices.size(), 0);
  parallel_for(mesh.vertices.size(), 1024, [&](std::size_t v) {
    std::array<ColorSample, kColoringViews> best;  // the best one first
    for (const DepthView& view : views) {
      ColorSample sample = sample_of(view, mesh.vertices[v], voxel);
      for (ColorSample& other : best)
        if (sample.weight > other.weight) std::swap(sample, other);
    }
    if (!best[0].color) return;
    is_seen[v] = 1;
    for (std::size_t channel = 0; channel < 3; ++channel) {
      float sum = 0, weights = 0;
      for (const ColorSample& sample : best) {
        if (!sample.color) break;
        sum += sample.weight * float(sample.color[channel]);
        weights += sample.weight;
      }
      mesh.colors[v][channel] = std::uint8_t(sum / weights + 0.5f);
    }
  });
  return is_seen;
}

}  // namespace gs
