// SPDX-License-Identifier: Apache-2.0
// Stages 4, 6 and 7 for surfaces (math/render/surface.h): goes through the tiles once more, as
// blend_values.cpp does. Of a fragment, the gradient by its alpha is that of one number,
// <row, dL/d(pixel)>, so that what is behind it is one number as well.
#include "gs_core/error.h"
#include "gs_core/math/render/blend.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_render/stages.h"
#include "gs_render/stages/tile_loop.h"

namespace gs {
namespace {

constexpr std::size_t kRowsPerTask = 256;
constexpr int kChannels = kSurfaceNumbers - 1;  // in use

/// The numbers of a row one by one.
struct RowNumbers {
  float of[kSurfaceNumbers];

  RowNumbers() = default;
  explicit RowNumbers(const SurfaceRow& row)
      : of{row.of.at_axis,  row.of.slope.x,  row.of.slope.y, row.of.normal.x,
           row.of.normal.y, row.of.normal.z, row.coverage,   0} {}
  SurfaceRow row() const { return {{of[0], {of[1], of[2]}, {of[3], of[4], of[5]}}, of[6]}; }
};

struct SurfacePixels {
  float sums[kChannels][kTilePixels];  // forward: of the pixel; backward: dL by them
  float transmittance[kTilePixels], behind[kTilePixels];
  std::uint32_t last[kTilePixels];
  std::uint32_t largest_last = 0;

  SurfacePixels(const RenderPass& pass, const Tile& tile, Span<const SurfaceRow> dL) {
    for (int pixel = 0; pixel < kTilePixels; ++pixel) {
      transmittance[pixel] = 1.0f;
      behind[pixel] = 0.0f;
      for (auto& channel : sums) channel[pixel] = 0.0f;
      last[pixel] = 0;
      if (!tile.contains(pass, pixel)) continue;
      const std::size_t from = tile.image_index(pass, pixel);
      last[pixel] = pass.last_instance[from];
      largest_last = std::max(largest_last, last[pixel]);
      if (dL.empty()) continue;
      const RowNumbers by(dL[from]), blended(pass.surface_image[from]);
      for (int c = 0; c < kChannels; ++c) {
        sums[c][pixel] = by.of[c];
        behind[pixel] += by.of[c] * blended.of[c];
      }
    }
  }
};

template <BlendRule rule>
void blend_surface_tile(RenderPass& pass, std::size_t tile_index) {
  const Tile tile(pass, tile_index);
  SurfacePixels pixels(pass, tile, {});
  for (std::uint32_t k = tile.begin; k < tile.end; ++k) {
    const std::uint32_t listed = pass.tile_splats[k], position = k - tile.begin;
    if (position >= pixels.largest_last) break;
    const Splat s = pass.splats[listed];
    const RowNumbers row(pass.surface_rows[listed]);
    for_each_lane_group(
        tile, pass.pixel_rects[listed], s.mean2d, [&](int first, float dx, float dy) {
          float weight[kLanes];
          for (int lane = 0; lane < kLanes; ++lane) {
            const int i = first + lane;
            const float exponent = fragment_exponent(s.conic, dx + float(lane), dy);
            const float gaussian = exp_fragment(max_of(exponent, kMinExponent));
            const bool keep = (position < pixels.last[i]) & (exponent >= -s.cutoff);
            const float alpha = keep ? fragment_alpha<rule>(s.opacity, gaussian) : 0.0f;
            weight[lane] = pixels.transmittance[i] * alpha;
            pixels.transmittance[i] *= 1.0f - alpha;
          }
          for (int c = 0; c < kChannels; ++c)
            for (int lane = 0; lane < kLanes; ++lane)
              pixels.sums[c][first + lane] += weight[lane] * row.of[c];
        });
  }
  for (int pixel = 0; pixel < kTilePixels; ++pixel) {
    if (!tile.contains(pass, pixel)) continue;
    RowNumbers sums{};
    for (int c = 0; c < kChannels; ++c) sums.of[c] = pixels.sums[c][pixel];
    pass.surface_image[tile.image_index(pass, pixel)] = sums.row();
  }
}

/// Sums of one instance, per lane.
struct SurfaceSums {
  float mean_x[kLanes] = {}, mean_y[kLanes] = {};
  float conic_xx[kLanes] = {}, conic_xy[kLanes] = {}, conic_yy[kLanes] = {};
  float opacity[kLanes] = {}, row[kChannels][kLanes] = {};

  void add_to(SplatGradient& to) const {
    to.mean2d += Vec2f(sum_of_lanes(mean_x), sum_of_lanes(mean_y));
    to.conic = {to.conic.xx + sum_of_lanes(conic_xx), to.conic.xy + sum_of_lanes(conic_xy),
                to.conic.yy + sum_of_lanes(conic_yy)};
    to.opacity += sum_of_lanes(opacity);
  }
  SurfaceRow of_row() const {
    RowNumbers sums{};
    for (int c = 0; c < kChannels; ++c) sums.of[c] = sum_of_lanes(row[c]);
    return sums.row();
  }
};

template <BlendRule rule>
void blend_surface_backward_lanes(const Splat& s, const RowNumbers& row, float dx, float dy,
                                  std::uint32_t position, int first, SurfacePixels& pixels,
                                  SurfaceSums& sums) {
  float shade[kLanes] = {}, weight[kLanes];
  for (int c = 0; c < kChannels; ++c)
    for (int lane = 0; lane < kLanes; ++lane)
      shade[lane] += row.of[c] * pixels.sums[c][first + lane];
  for (int lane = 0; lane < kLanes; ++lane) {
    const int i = first + lane;
    const float x = dx + float(lane), exponent = fragment_exponent(s.conic, x, dy);
    const float gaussian = exp_fragment(max_of(exponent, kMinExponent));
    const bool keep = (position < pixels.last[i]) & (exponent >= -s.cutoff);
    const float alpha = keep ? fragment_alpha<rule>(s.opacity, gaussian) : 0.0f;
    weight[lane] = pixels.transmittance[i] * alpha;
    const float is_before_last = position + 1 == pixels.last[i] ? 0.0f : 1.0f;
    pixels.behind[i] = is_before_last * (pixels.behind[i] - weight[lane] * shade[lane]);
    const float q = 1.0f / max_of(1.0f - alpha, kMinOneMinusAlpha);
    const float dL_dalpha =
        keep ? pixels.transmittance[i] * shade[lane] - q * pixels.behind[i] : 0.0f;
    pixels.transmittance[i] *= 1.0f - alpha;
    const AlphaGradient<float> by = fragment_alpha_vjp<rule>(s.opacity, gaussian, dL_dalpha);
    const ExponentGradient<float> by_exponent = fragment_exponent_vjp(s.conic, x, dy, by.exponent);
    sums.mean_x[lane] += by_exponent.mean2d.x;
    sums.mean_y[lane] += by_exponent.mean2d.y;
    sums.conic_xx[lane] += by_exponent.conic.xx;
    sums.conic_xy[lane] += by_exponent.conic.xy;
    sums.conic_yy[lane] += by_exponent.conic.yy;
    sums.opacity[lane] += by.opacity;
  }
  for (int c = 0; c < kChannels; ++c)
    for (int lane = 0; lane < kLanes; ++lane)
      sums.row[c][lane] += weight[lane] * pixels.sums[c][first + lane];
}

template <BlendRule rule>
void blend_surface_backward_tile(Span<const SurfaceRow> dL, RenderPass& pass,
                                 std::size_t tile_index) {
  const Tile tile(pass, tile_index);
  ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  SurfacePixels pixels(pass, tile, dL);
  for (std::uint32_t k = tile.begin; k < tile.end; ++k) {
    SurfaceSums sums;
    const std::uint32_t listed = pass.tile_splats[k], position = k - tile.begin;
    if (position < pixels.largest_last) {
      const Splat splat = pass.splats[listed];
      const RowNumbers row(pass.surface_rows[listed]);
      for_each_lane_group(
          tile, pass.pixel_rects[listed], splat.mean2d, [&](int first, float dx, float dy) {
            blend_surface_backward_lanes<rule>(splat, row, dx, dy, position, first, pixels, sums);
          });
    }
    const std::uint32_t instance = scratch.tile_instances[k];
    sums.add_to(scratch.instance_gradients[instance]);
    scratch.surface_gradients[instance] = sums.of_row();
  }
}

GaussianShape<float> shape_of(const GaussiansSpan& gaussians, std::size_t i) {
  return {gaussians.mean[i], gaussians.log_scale[i], gaussians.rotation[i]};
}
float filter_of(const GaussiansSpan& gaussians, std::size_t i) {
  return gaussians.has_filter ? gaussians.filter_scale[i] : 0.0f;
}

}  // namespace

void blend_surface(const GaussiansSpan& gaussians, const Camera& camera,
                   const RenderSettings& settings, RenderPass& pass) {
  pass.surface_rows.resize_discard(settings.blends_surface ? gaussians.mean.size : 0);
  pass.surface_image.resize_discard(settings.blends_surface ? pass.pixel_count() : 0);
  if (!settings.blends_surface) return;
  const HostStage stage("blend surface");
  GS_CHECK(!gaussians.has_time && !camera.has_lens() && pass.ray_depths.empty());
  parallel_for(pass.surface_rows.size(), kRowsPerTask, [&](std::size_t i) {
    if (pass.tile_counts[i])
      pass.surface_rows[i] =
          surface_row(camera, shape_of(gaussians, i), filter_of(gaussians, i), settings);
  });
  const bool is_classic = settings.blend_rule == BlendRule::classic;
  parallel_for(pass.tile_count(), 1, [&](std::size_t tile) {
    is_classic ? blend_surface_tile<BlendRule::classic>(pass, tile)
               : blend_surface_tile<BlendRule::faster_gs>(pass, tile);
  });
}

void blend_surface_backward(const RenderSettings& settings, Span<const SurfaceRow> dL,
                            RenderPass& pass) {
  const HostStage stage("blend surface backward");
  ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  scratch.surface_gradients.resize_discard(scratch.instance_gradients.size());
  if (pass.tile_splats.size() < scratch.surface_gradients.size())  // those of masked tiles
    scratch.surface_gradients.fill_zero();
  const bool is_classic = settings.blend_rule == BlendRule::classic;
  parallel_for(pass.tile_count(), 1, [&](std::size_t tile) {
    is_classic ? blend_surface_backward_tile<BlendRule::classic>(dL, pass, tile)
               : blend_surface_backward_tile<BlendRule::faster_gs>(dL, pass, tile);
  });
}

void surface_backward(const GaussiansSpan& gaussians, const Camera& camera,
                      const RenderSettings& settings, const RenderPass& pass,
                      const GaussiansSpan& gradients) {
  const HostStage stage("surface backward");
  const ScalarScratch& scratch = pass.scratch<ScalarScratch>();
  parallel_for(gaussians.mean.size, kRowsPerTask, [&](std::size_t i) {
    if (!pass.tile_counts[i]) return;
    const std::uint32_t begin = scratch.first_instance[i], end = begin + pass.tile_counts[i];
    RowNumbers sum{};
    for (std::uint32_t instance = begin; instance < end; ++instance) {
      const RowNumbers part(scratch.surface_gradients[instance]);
      for (int c = 0; c < kChannels; ++c) sum.of[c] += part.of[c];
    }
    const GaussianShape<float> dL = surface_row_vjp(camera, shape_of(gaussians, i),
                                                    filter_of(gaussians, i), settings, sum.row());
    gradients.mean[i] += dL.mean;
    gradients.log_scale[i] += dL.log_scale;
    Quatf& q = gradients.rotation[i];
    q = {q.w + dL.rotation.w, q.x + dL.rotation.x, q.y + dL.rotation.y, q.z + dL.rotation.z};
  });
}

}  // namespace gs
