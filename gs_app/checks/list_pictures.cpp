// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checks/list_pictures.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

namespace gs {
namespace {

constexpr int kTileSide = 4;  // pixels of the picture

// How many Gaussians the tiles of a view list, row by row.
struct Lists {
  const char* name;
  int tiles_x, tiles_y;
  std::vector<std::uint32_t> lengths;

  std::uint32_t longest() const { return *std::max_element(lengths.begin(), lengths.end()); }
  std::uint64_t sum() const { return std::accumulate(lengths.begin(), lengths.end(), 0ull); }
};

Lists tile_lengths(const char* name, const RenderPass& pass) {
  Lists lists{name, pass.tiles_x, pass.tiles_y, {}};
  const std::vector<std::uint32_t> ranges = pass.tile_ranges.download();
  for (std::size_t tile = 0; tile < pass.tile_count(); ++tile)
    lists.lengths.push_back(ranges[tile + 1] - ranges[tile]);
  return lists;
}

// From dark blue by red and yellow to white; `value` from 0 to 1.
std::array<std::uint8_t, 3> color_of(double value) {
  constexpr double kStops[][3] = {
      {10, 10, 40}, {110, 20, 110}, {220, 60, 50}, {250, 200, 60}, {255, 255, 255}};
  constexpr int kLast = int(std::size(kStops)) - 1;
  const double at = std::clamp(value, 0.0, 1.0) * kLast;
  const int stop = std::min(int(at), kLast - 1);
  std::array<std::uint8_t, 3> color;
  for (int c = 0; c < 3; ++c)
    color[c] = std::uint8_t(
        std::lround(kStops[stop][c] + (at - stop) * (kStops[stop + 1][c] - kStops[stop][c])));
  return color;
}

// Lengths by their square roots, so that short lists can be told apart, too.
Image8 picture_of(const Lists& lists, double longest) {
  Image8 picture(lists.tiles_x * kTileSide, lists.tiles_y * kTileSide, 3);
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) {
      const double length =
          lists.lengths[std::size_t(y / kTileSide) * lists.tiles_x + x / kTileSide];
      const auto color = color_of(std::sqrt(length / std::max(longest, 1.0)));
      std::copy(color.begin(), color.end(),
                picture.pixels.begin() + 3 * (std::size_t(y) * picture.width + x));
    }
  return picture;
}

}  // namespace

ListPictures list_pictures(Backend& backend, const GaussiansSpan& gaussians, const Camera& camera,
                           RenderSettings settings) {
  settings.for_backward = false;
  RenderPass pass(backend.memory());
  std::vector<Lists> all;
  for (const auto& [bounds, name] : {std::pair{TileBounds::square, "square"},
                                     {TileBounds::box, "box"},
                                     {TileBounds::exact, "exact"}}) {
    settings.bounds = bounds;
    backend.renderer().forward(gaussians, camera, settings, pass);
    all.push_back(tile_lengths(name, pass));
  }
  ListPictures pictures;
  pictures.table = fmt::format("\nlists of a view of {}x{} pixels\n  {:<7} {:>12} {:>9}\n",
                               camera.width, camera.height, "bounds", "Gaussians", "longest");
  for (const Lists& lists : all) {
    pictures.files.emplace(fmt::format("lists_{}.png", lists.name),
                           picture_of(lists, all.front().longest()));
    pictures.table +=
        fmt::format("  {:<7} {:>12} {:>9}\n", lists.name, lists.sum(), lists.longest());
  }
  return pictures;
}

}  // namespace gs
