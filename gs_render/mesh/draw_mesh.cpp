// SPDX-License-Identifier: Apache-2.0
#include "gs_render/mesh/draw_mesh.h"

#include <array>
#include <cmath>

#include "gs_core/math/render/projection.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/between_pixels.h"

namespace gs {
namespace {

constexpr int kSide = 2;              // samples of a pixel along each axis
constexpr int kBandRows = 8 * kSide;  // samples; a band is drawn by one thread
constexpr float kNearest = 1e-3f;     // world units; what is nearer is cut away
constexpr Vec3f kNoColor{0.5f};

using Vec2d = Vec2<double>;

/// A corner in camera coordinates, with its color or its place in the texture.
struct Corner {
  Vec3f at, value;
};

/// A corner in the picture.
struct ScreenCorner {
  Vec2d at;  // samples
  double inverse_depth;
  Vec3f value;
};

/// The part of a triangle beyond the nearest depth: a convex polygon.
struct Polygon {
  std::array<Corner, 4> corners;
  std::size_t count = 0;

  explicit Polygon(const std::array<Corner, 3>& triangle) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Corner &a = triangle[k], &b = triangle[(k + 1) % 3];
      if (a.at.z >= kNearest) corners[count++] = a;
      if ((a.at.z >= kNearest) == (b.at.z >= kNearest)) continue;
      const float share = (kNearest - a.at.z) / (b.at.z - a.at.z);
      corners[count++] = {a.at + share * (b.at - a.at), a.value + share * (b.value - a.value)};
      corners[count - 1].at.z = kNearest;
    }
  }
};

/// Some rows of samples.
struct Band {
  int width, first, last;  // rows [first, last) of the picture
  std::vector<double> inverse_depth;
  std::vector<Vec3f> value;

  Band(int width, int first, int last)
      : width(width), first(first), last(last),
        inverse_depth(std::size_t(width) * std::size_t(last - first), 0),
        value(inverse_depth.size()) {}

  void draw(const ScreenCorner& a, const ScreenCorner& b, const ScreenCorner& c) {
    const auto cross_of = [](const Vec2d& from, const Vec2d& to, const Vec2d& p) {
      return (to.x - from.x) * (p.y - from.y) - (to.y - from.y) * (p.x - from.x);
    };
    const double area = cross_of(a.at, b.at, c.at);
    if (!(std::abs(area) > 0)) return;
    // Samples lie at the middle of their square.
    const auto first_of = [](double low, int least) {
      return int(std::clamp(std::ceil(low - 0.5), double(least), 1e9));
    };
    const auto end_of = [](double high, int most) {
      return int(std::clamp(std::floor(high - 0.5) + 1, -1e9, double(most)));
    };
    const int x0 = first_of(std::min({a.at.x, b.at.x, c.at.x}), 0);
    const int x1 = end_of(std::max({a.at.x, b.at.x, c.at.x}), width);
    const int y0 = first_of(std::min({a.at.y, b.at.y, c.at.y}), first);
    const int y1 = end_of(std::max({a.at.y, b.at.y, c.at.y}), last);
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x) {
        const Vec2d p(x + 0.5, y + 0.5);
        const double u = cross_of(b.at, c.at, p) / area, v = cross_of(c.at, a.at, p) / area;
        const double w = 1 - u - v;
        if (u < 0 || v < 0 || w < 0) continue;
        const double pa = u * a.inverse_depth, pb = v * b.inverse_depth, pc = w * c.inverse_depth;
        const std::size_t i = std::size_t(y - first) * std::size_t(width) + std::size_t(x);
        if (pa + pb + pc <= inverse_depth[i]) continue;
        inverse_depth[i] = pa + pb + pc;
        const double all = inverse_depth[i];
        value[i] =
            float(pa / all) * a.value + float(pb / all) * b.value + float(pc / all) * c.value;
      }
  }
};

Vec3f texel_at(const Image8& texture, const Vec3f& place) {
  return kPerByte *
         between_pixels(texture, {place.x * float(texture.width), place.y * float(texture.height)});
}

class Drawing {
 public:
  Drawing(const TriangleMesh& mesh, const Camera& camera) : mesh_(mesh), camera_(camera) {
    corners_.resize(mesh.vertices.size());
    rows_.resize(mesh.vertices.size());
    parallel_for(mesh.vertices.size(), 4096, [&](std::size_t v) {
      corners_[v] = {to_camera(camera, mesh.vertices[v]), value_of(v)};
      const bool is_ahead = corners_[v].at.z >= kNearest &&
                            (!camera.has_lens() || is_in_sight(camera, corners_[v].at));
      rows_[v] = is_ahead ? float(on_screen(corners_[v]).at.y) : NAN;
    });
    sort_into_bands();
  }

  /// Adds what a band shows to the picture. Returns how many samples show the mesh.
  std::size_t draw_band(std::size_t number, const Vec3f& background, ImageF& picture) const {
    const int first = int(number) * kBandRows;
    Band band(camera_.width * kSide, first, std::min(first + kBandRows, camera_.height * kSide));
    for (const std::uint32_t t : bands_[number]) {
      const Triangle& triangle = mesh_.triangles[t];
      const Polygon polygon({corners_[triangle[0]], corners_[triangle[1]], corners_[triangle[2]]});
      std::array<ScreenCorner, 4> corners;
      for (std::size_t k = 0; k < polygon.count; ++k) corners[k] = on_screen(polygon.corners[k]);
      for (std::size_t k = 2; k < polygon.count; ++k)
        band.draw(corners[0], corners[k - 1], corners[k]);
    }
    constexpr float kShare = 1.0f / (kSide * kSide);
    std::size_t covered = 0, i = 0;
    for (int y = band.first; y < band.last; ++y)
      for (int x = 0; x < band.width; ++x, ++i) {
        const bool is_covered = band.inverse_depth[i] > 0;
        covered += is_covered;
        Vec3f color = is_covered ? band.value[i] : background;
        if (is_covered && has_texture()) color = texel_at(mesh_.texture, color);
        for (int c = 0; c < 3; ++c) picture.at(x / kSide, y / kSide, c) += kShare * color[c];
      }
    return covered;
  }

  std::size_t band_count() const { return bands_.size(); }

 private:
  bool has_texture() const { return !mesh_.texture_places.empty(); }
  Vec3f value_of(std::size_t v) const {
    if (has_texture()) return {mesh_.texture_places[v].x, mesh_.texture_places[v].y, 0};
    if (mesh_.colors.empty()) return kNoColor;
    const Rgb8& color = mesh_.colors[v];
    return kPerByte * Vec3f(color[0], color[1], color[2]);
  }
  ScreenCorner on_screen(const Corner& corner) const {
    return {double(kSide) * Vec2d(pixel_of(camera_, corner.at)), 1 / double(corner.at.z),
            corner.value};
  }
  /// The triangles of each band, in their order.
  void sort_into_bands() {
    const int rows = camera_.height * kSide, count = (rows + kBandRows - 1) / kBandRows;
    bands_.resize(std::size_t(count));
    for (std::size_t t = 0; t < mesh_.triangles.size(); ++t) {
      float low = INFINITY, high = -INFINITY;
      std::size_t in_front = 0;
      for (const std::uint32_t v : mesh_.triangles[t]) {
        if (std::isnan(rows_[v])) continue;
        ++in_front;
        low = std::min(low, rows_[v]), high = std::max(high, rows_[v]);
      }
      if (in_front == 0 || (in_front < 3 && camera_.has_lens())) continue;
      if (in_front < 3) low = 0, high = float(rows);  // it reaches past the camera
      if (high < 0 || low >= float(rows)) continue;
      const int last = int(std::min(high, float(rows - 1))) / kBandRows;
      for (int band = int(std::max(low, 0.0f)) / kBandRows; band <= last; ++band)
        bands_[std::size_t(band)].push_back(std::uint32_t(t));
    }
  }

  const TriangleMesh& mesh_;
  const Camera& camera_;
  std::vector<Corner> corners_;  // (V)
  std::vector<float> rows_;      // (V)  in samples; NaN: not in front of the camera
  std::vector<std::vector<std::uint32_t>> bands_;
};

}  // namespace

MeshPicture draw_mesh(const TriangleMesh& mesh, const Camera& camera, const Vec3f& background) {
  MeshPicture result{ImageF(camera.width, camera.height, 3)};
  const Drawing drawing(mesh, camera);
  std::vector<std::size_t> covered(drawing.band_count());
  parallel_for(covered.size(), 1, [&](std::size_t band) {
    covered[band] = drawing.draw_band(band, background, result.color);
  });
  std::size_t sum = 0;
  for (const std::size_t count : covered) sum += count;
  result.covered = double(sum) / (double(kSide * kSide) * camera.width * camera.height);
  return result;
}

}  // namespace gs
