// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checks/stage_traffic.h"

#include <bit>
#include <cmath>
#include <cstdint>

#include "gs_core/gaussians.h"
#include "gs_render/render_pass.h"

namespace gs {
namespace {

// bytes a Gaussian
constexpr double kShape = sizeof(Vec3f) + sizeof(Vec3f) + sizeof(Quatf) + sizeof(float);
constexpr double kCount = 4, kDepth = 4, kIndex = 4;  // bytes each
constexpr double kGradientSum = 48;                   // bytes; dL/d(splat), padded
constexpr double kDigit = 8;                          // bits per pass of a radix sort

double sh_rest_bytes(const Workload& w) { return 12.0 * sh_rest_count(w.sh_degree); }
/// A packed model's ellipsoid, and its color in whole vectors of 16 bytes.
constexpr double kEllipsoid = sizeof(Vec3f) + 6 * sizeof(float) + sizeof(float);
double packed_color_bytes(const Workload& w) {
  const double numbers = 3.0 * sh_rest_count(w.sh_degree);
  const double bytes = 16 + 2 * numbers;
  return 16 * std::ceil(bytes / 16);
}
// The size of both moments, as a share of that of the parameters.
double moments_per_parameter(const Workload& w) { return moment_bytes(w.moments) / 4.0; }
double tile_bits(const Workload& w) { return std::bit_width(std::uint64_t(w.tiles)); }
double tile_key(const Workload& w) { return w.tiles < 65536 ? 2 : 4; }
/// A sort of `items` keys with an index each: the keys are read once, then each pass reads and
/// writes everything.
double sort_bytes(double items, double key, double bits) {
  return items * (key + std::ceil(bits / kDigit) * 2 * (key + kIndex));
}

struct Rule {
  const char* stage;
  double (*bytes)(const Workload&);
};

constexpr Rule kRules[] = {
    // Reads shape and SH degree 0 of all and the other degrees of the visible; writes count and key
    // of all, splat of the visible. Of a packed model all of the color is read only of the visible.
    {"preprocess",
     [](const Workload& w) {
       if (w.is_packed)
         return w.gaussians * (kEllipsoid + kCount + kDepth) +
                w.visible * (packed_color_bytes(w) + w.splat_bytes + sizeof(Rect));
       return w.gaussians * (kShape + 12 + kCount + kDepth) +
              w.visible * (sh_rest_bytes(w) + w.splat_bytes + sizeof(Rect));
     }},
    // Sorts all by the bits of the depth that make its key; sums the counts in that order (reads
    // order and count, writes the sum).
    {"depth sort",
     [](const Workload& w) {
       return sort_bytes(w.gaussians, kDepth, kDepthKeyBits) + w.gaussians * (kIndex + 2 * kCount);
     }},
    // Reads order, count and sum of all, rectangle and splat of the visible; writes key and index
    // of each instance.
    {"instances",
     [](const Workload& w) {
       return w.gaussians * (kIndex + 2 * kCount) + w.visible * (sizeof(Rect) + w.splat_bytes) +
              w.instances * (tile_key(w) + kIndex);
     }},
    // Sorts by as many bits as there are tiles; reads the keys once more for the tiles' ranges.
    {"tile sort",
     [](const Workload& w) {
       return sort_bytes(w.instances, tile_key(w), tile_bits(w)) + w.instances * tile_key(w) +
              w.tiles * kIndex;
     }},
    // Two passes over picture (float) and photo (byte), three channels: the first writes three
    // derivatives of SSIM a value, the second reads them and writes the gradient.
    {"loss", [](const Workload& w) { return 3 * w.pixels * (2 * (4 + 1) + 2 * 3 * 4 + 4); }},
    // Reads and writes every parameter in use and its two moments, visible or not; reads and clears
    // the visible's dL/d(splat), reads their color, reads and writes their statistics.
    {"preprocess backward, Adam",
     [](const Workload& w) {
       const double arrays = 1 + moments_per_parameter(w);
       return w.gaussians * (2 * arrays * (kShape + 12 + sh_rest_bytes(w)) + kCount) +
              w.visible * (2 * kGradientSum + 12 + 2 * 8);
     }},
};

}  // namespace

std::optional<double> stage_bytes(const std::string& stage, const Workload& workload) {
  for (const Rule& rule : kRules)
    if (stage == rule.stage) return rule.bytes(workload);
  return std::nullopt;
}

}  // namespace gs
