// SPDX-License-Identifier: Apache-2.0
#include "gs_model/mesh/unwrap_mesh.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"

namespace gs {
namespace {

constexpr std::uint32_t kNone = ~0u;
constexpr int kDirections = 14;  // of the faces and corners of a cube
constexpr int kSmoothings = 3;   // passes that give triangles the direction of their neighbors
constexpr float kLeastFacing =
    0.2f;  // cosine of a triangle's normal and the direction of its chart
constexpr int kSmallestSide = 64;
constexpr float kCoarser = 1.02f;  // steps of the size of a texel
constexpr std::uint8_t kGray = 128;

std::array<Vec3f, kDirections> all_directions() {
  std::array<Vec3f, kDirections> directions;
  std::size_t count = 0;
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {-1.0f, 1.0f}) (directions[count++] = Vec3f(0))[axis] = sign;
  for (int corner = 0; corner < 8; ++corner)
    directions[count++] =
        unit(Vec3f(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1));
  return directions;
}

using Neighbors = std::vector<std::array<std::uint32_t, 3>>;

/// The triangle beyond each edge of each triangle, or kNone.
Neighbors neighbors_of(const TriangleMesh& mesh) {
  struct Edge {
    std::uint32_t low, high, triangle, side;
  };
  std::vector<Edge> edges;
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t)
    for (std::uint32_t k = 0; k < 3; ++k) {
      const std::uint32_t a = mesh.triangles[t][k], b = mesh.triangles[t][(k + 1) % 3];
      edges.push_back({std::min(a, b), std::max(a, b), t, k});
    }
  std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) {
    return std::tie(a.low, a.high, a.triangle) < std::tie(b.low, b.high, b.triangle);
  });
  Neighbors neighbors(mesh.triangles.size(), {kNone, kNone, kNone});
  for (std::size_t e = 0; e + 1 < edges.size(); ++e) {
    const Edge &a = edges[e], &b = edges[e + 1];
    if (a.low != b.low || a.high != b.high) continue;
    neighbors[a.triangle][a.side] = b.triangle;
    neighbors[b.triangle][b.side] = a.triangle;
    ++e;
  }
  return neighbors;
}

/// The direction that each triangle is projected along.
std::vector<int> directions_of(const TriangleMesh& mesh, const Neighbors& neighbors,
                               const std::array<Vec3f, kDirections>& directions) {
  std::vector<int> chosen(mesh.triangles.size());
  std::vector<Vec3f> faces(mesh.triangles.size());
  const auto best = [&](const Vec3f& normal) {
    int result = 0;
    for (int d = 1; d < kDirections; ++d)
      if (inner(normal, directions[d]) > inner(normal, directions[result])) result = d;
    return result;
  };
  const auto faces_it = [&](std::size_t t, int d) {
    return inner(faces[t], directions[d]) >= kLeastFacing;
  };
  for (std::size_t t = 0; t < chosen.size(); ++t) {
    const Triangle& corners = mesh.triangles[t];
    const Vec3f& a = mesh.vertices[corners[0]];
    const Vec3f n = cross(mesh.vertices[corners[1]] - a, mesh.vertices[corners[2]] - a);
    faces[t] = length(n) > 0 ? unit(n) : Vec3f(0, 0, 1);
    // Normals of vertices are smoother than those of triangles, so that charts are larger.
    chosen[t] =
        best(mesh.normals[corners[0]] + mesh.normals[corners[1]] + mesh.normals[corners[2]]);
    if (!faces_it(t, chosen[t])) chosen[t] = best(faces[t]);
  }
  for (int pass = 0; pass < kSmoothings; ++pass) {
    const std::vector<int> before = chosen;
    for (std::size_t t = 0; t < chosen.size(); ++t)
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t a = neighbors[t][k], b = neighbors[t][(k + 1) % 3];
        if (a != kNone && b != kNone && before[a] == before[b] && faces_it(t, before[a]))
          chosen[t] = before[a];
      }
  }
  return chosen;
}

/// Triangles side by side in the texture.
struct Chart {
  int direction = 0;
  Vec2f low{0}, high{0};      // of its projection, world units
  int x = 0, y = 0;           // of its corner in the texture, with the gutter
  int width = 0, height = 0;  // texels, the same
  bool is_turned = false;     // the two axes change places, so that it is wider than high
};

struct Charts {
  std::vector<Chart> charts;
  std::vector<std::uint32_t> of_triangle;
};

/// Connected triangles of one direction.
Charts charts_of(const std::vector<int>& directions, const Neighbors& neighbors) {
  Charts result;
  result.of_triangle.assign(directions.size(), kNone);
  std::vector<std::uint32_t> open;
  for (std::uint32_t first = 0; first < directions.size(); ++first) {
    if (result.of_triangle[first] != kNone) continue;
    const auto chart = std::uint32_t(result.charts.size());
    result.charts.push_back({directions[first]});
    result.of_triangle[first] = chart;
    open.push_back(first);
    while (!open.empty()) {
      const std::uint32_t t = open.back();
      open.pop_back();
      for (const std::uint32_t next : neighbors[t]) {
        if (next == kNone || result.of_triangle[next] != kNone) continue;
        if (directions[next] != directions[first]) continue;
        result.of_triangle[next] = chart;
        open.push_back(next);
      }
    }
  }
  return result;
}

/// Gives each chart vertices of its own. Returns the chart of each vertex.
std::vector<std::uint32_t> split_vertices(TriangleMesh& mesh, const Charts& charts) {
  std::vector<std::pair<std::uint64_t, std::size_t>> uses;  // (chart, vertex) and the corner
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    for (std::size_t k = 0; k < 3; ++k)
      uses.emplace_back(std::uint64_t(charts.of_triangle[t]) << 32 | mesh.triangles[t][k],
                        3 * t + k);
  std::sort(uses.begin(), uses.end());
  TriangleMesh split;
  split.triangles.resize(mesh.triangles.size());
  std::vector<std::uint32_t> chart_of_vertex;
  for (std::size_t i = 0; i < uses.size(); ++i) {
    if (i == 0 || uses[i].first != uses[i - 1].first) {
      const auto vertex = std::uint32_t(uses[i].first);
      split.vertices.push_back(mesh.vertices[vertex]);
      split.normals.push_back(mesh.normals[vertex]);
      split.colors.push_back(mesh.colors[vertex]);
      chart_of_vertex.push_back(std::uint32_t(uses[i].first >> 32));
    }
    split.triangles[uses[i].second / 3][uses[i].second % 3] =
        std::uint32_t(split.vertices.size() - 1);
  }
  mesh = std::move(split);
  return chart_of_vertex;
}

/// Lays the charts in rows, the high ones first. Returns the height of all rows; more than any
/// texture has where a chart is too wide.
std::int64_t pack(std::vector<Chart>& charts, int width, float texel) {
  for (Chart& chart : charts) {
    Vec2f size = (chart.high - chart.low) / texel;
    chart.is_turned = size.y > size.x;
    if (chart.is_turned) std::swap(size.x, size.y);
    if (!(size.x < float(width))) return std::numeric_limits<std::int64_t>::max();
    chart.width = int(std::ceil(size.x)) + 1 + 2 * kTextureGutter;
    chart.height = int(std::ceil(size.y)) + 1 + 2 * kTextureGutter;
    if (chart.width > width) return std::numeric_limits<std::int64_t>::max();
  }
  std::vector<std::uint32_t> order(charts.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return charts[a].height > charts[b].height;
  });
  std::int64_t top = 0, x = 0, row_height = 0;
  for (const std::uint32_t i : order) {
    Chart& chart = charts[i];
    if (x + chart.width > width) top += row_height, x = 0, row_height = 0;
    chart.x = int(x), chart.y = int(std::min<std::int64_t>(top, width));
    x += chart.width;
    row_height = std::max<std::int64_t>(row_height, chart.height);
  }
  return top + row_height;
}

}  // namespace

float unwrap_mesh(TriangleMesh& mesh, const UnwrapRule& rule) {
  const std::array<Vec3f, kDirections> directions = all_directions();
  std::array<std::array<Vec3f, 2>, kDirections> axes;
  for (std::size_t d = 0; d < kDirections; ++d) {
    const std::array<Vec3d, 2> across = axes_across(Vec3d(directions[d]));
    axes[d] = {Vec3f(across[0]), Vec3f(across[1])};
  }
  const Neighbors neighbors = neighbors_of(mesh);
  Charts all = charts_of(directions_of(mesh, neighbors, directions), neighbors);
  std::vector<Chart>& charts = all.charts;
  const std::vector<std::uint32_t> chart_of_vertex = split_vertices(mesh, all);
  std::vector<Vec2f>& places = mesh.texture_places;  // in world units until charts are laid out
  places.resize(mesh.vertices.size());
  std::vector<char> is_begun(charts.size(), 0);
  for (std::size_t v = 0; v < places.size(); ++v) {
    Chart& chart = charts[chart_of_vertex[v]];
    const auto& [x, y] = axes[std::size_t(chart.direction)];
    const Vec2f at(inner(mesh.vertices[v], x), inner(mesh.vertices[v], y));
    places[v] = at;
    char& begun = is_begun[chart_of_vertex[v]];
    chart.low = begun ? Vec2f(std::min(chart.low.x, at.x), std::min(chart.low.y, at.y)) : at;
    chart.high = begun ? Vec2f(std::max(chart.high.x, at.x), std::max(chart.high.y, at.y)) : at;
    begun = 1;
  }
  float texel = rule.texel, widest = 0;
  for (const Chart& chart : charts)
    widest = std::max({widest, chart.high.x - chart.low.x, chart.high.y - chart.low.y});
  int side = std::min(kSmallestSide, rule.largest);
  std::int64_t height = pack(charts, side, texel);
  while (height > side && side < rule.largest) {
    side = std::min(2 * side, rule.largest);
    height = pack(charts, side, texel);
  }
  for (; height > side; height = pack(charts, side, texel)) {
    if (texel > widest)
      throw Error(
          fmt::format("the surface falls into {} parts, which do not fit into a texture of "
                      "{} pixels; give --decimate, a larger --voxel, or --texture {}",
                      charts.size(), side, 2 * side));
    texel *= kCoarser;
  }
  mesh.texture = Image8(side, int(height), 3, kGray);
  for (std::size_t v = 0; v < places.size(); ++v) {
    const Chart& chart = charts[chart_of_vertex[v]];
    Vec2f at = (places[v] - chart.low) / texel;
    if (chart.is_turned) std::swap(at.x, at.y);
    const float border = float(kTextureGutter) + 0.5f;
    places[v] = {(float(chart.x) + border + at.x) / float(side),
                 (float(chart.y) + border + at.y) / float(height)};
  }
  return texel;
}

}  // namespace gs
