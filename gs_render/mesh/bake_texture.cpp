// SPDX-License-Identifier: Apache-2.0
#include "gs_render/mesh/bake_texture.h"

#include <algorithm>
#include <cmath>

#include "gs_core/threads/parallel.h"
#include "gs_render/fusion/view_color.h"

namespace gs {
namespace {

constexpr std::uint32_t kNobody = ~0u;

/// Shares of the corners of a triangle of the plane at a place.
struct PlanarTriangle {
  Vec2f a, b, c;

  PlanarTriangle(const TriangleMesh& mesh, const Triangle& t) {
    const auto texels = [&](std::uint32_t v) {
      return Vec2f(mesh.texture_places[v].x * float(mesh.texture.width),
                   mesh.texture_places[v].y * float(mesh.texture.height));
    };
    a = texels(t[0]), b = texels(t[1]), c = texels(t[2]);
  }
  static float cross_of(const Vec2f& from, const Vec2f& to, const Vec2f& p) {
    return (to.x - from.x) * (p.y - from.y) - (to.y - from.y) * (p.x - from.x);
  }
  Vec3f shares_at(const Vec2f& p) const {
    const float area = cross_of(a, b, c);
    const float u = cross_of(b, c, p) / area, v = cross_of(c, a, p) / area;
    return {u, v, 1 - u - v};
  }
};

/// The triangle that covers the middle of each texel.
std::vector<std::uint32_t> owners_of(const TriangleMesh& mesh) {
  const int width = mesh.texture.width, height = mesh.texture.height;
  std::vector<std::uint32_t> owners(std::size_t(width) * std::size_t(height), kNobody);
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const PlanarTriangle flat(mesh, mesh.triangles[t]);
    const auto range = [](float a, float b, float c, int size) {
      const float low = std::min({a, b, c}), high = std::max({a, b, c});
      return std::pair(std::max(0, int(std::ceil(low - 0.5f))),
                       std::min(size - 1, int(std::floor(high - 0.5f))));
    };
    const auto [x0, x1] = range(flat.a.x, flat.b.x, flat.c.x, width);
    const auto [y0, y1] = range(flat.a.y, flat.b.y, flat.c.y, height);
    for (int y = y0; y <= y1; ++y)
      for (int x = x0; x <= x1; ++x) {
        const Vec3f shares = flat.shares_at({float(x) + 0.5f, float(y) + 0.5f});
        if (!(shares.x >= 0 && shares.y >= 0 && shares.z >= 0)) continue;
        std::uint32_t& owner = owners[std::size_t(y) * std::size_t(width) + std::size_t(x)];
        if (owner == kNobody) owner = t;
      }
  }
  return owners;
}

/// Gives texels that have no color the mean of those around them that have one.
void grow(Image8& texture, std::vector<char>& is_painted) {
  const std::vector<char> before = is_painted;
  parallel_for(std::size_t(texture.height), 16, [&](std::size_t row) {
    const int y = int(row);
    for (int x = 0; x < texture.width; ++x) {
      const auto index = [&](int px, int py) {
        return std::size_t(py) * std::size_t(texture.width) + std::size_t(px);
      };
      if (before[index(x, y)]) continue;
      std::array<int, 3> sums{};
      int count = 0;
      for (int py = std::max(0, y - 1); py <= std::min(texture.height - 1, y + 1); ++py)
        for (int px = std::max(0, x - 1); px <= std::min(texture.width - 1, x + 1); ++px) {
          if (!before[index(px, py)]) continue;
          for (int c = 0; c < 3; ++c) sums[std::size_t(c)] += texture.at(px, py, c);
          ++count;
        }
      if (count == 0) continue;
      for (int c = 0; c < 3; ++c)
        texture.at(x, y, c) = std::uint8_t((sums[std::size_t(c)] + count / 2) / count);
      is_painted[index(x, y)] = 1;
    }
  });
}

}  // namespace

void bake_texture(const std::vector<DepthView>& views, float voxel, int gutter,
                  TriangleMesh& mesh) {
  const std::vector<std::uint32_t> owners = owners_of(mesh);
  std::vector<char> is_painted(owners.size(), 0);
  const auto width = std::size_t(mesh.texture.width);
  parallel_for(owners.size(), 1024, [&](std::size_t i) {
    if (owners[i] == kNobody) return;
    const Triangle& t = mesh.triangles[owners[i]];
    const Vec3f shares =
        PlanarTriangle(mesh, t).shares_at({float(i % width) + 0.5f, float(i / width) + 0.5f});
    Vec3f p(0), color(0);
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t v = t[std::size_t(k)];
      p += shares[k] * mesh.vertices[v];
      for (int c = 0; c < 3; ++c) color[c] += shares[k] * float(mesh.colors[v][std::size_t(c)]);
    }
    if (const std::optional<Vec3f> seen = view_color(views, p, voxel)) color = *seen;
    for (int c = 0; c < 3; ++c) mesh.texture.pixels[3 * i + std::size_t(c)] = byte_of(color[c]);
    is_painted[i] = 1;
  });
  for (int step = 0; step < gutter; ++step) grow(mesh.texture, is_painted);
}

}  // namespace gs
