// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checks/blenders.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "gs_core/math/render/blend.h"
#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

struct Blender {
  const char* name;
  bool use_tensor_cores;
};
constexpr Blender kBlenders[] = {{"simt", false}, {"gemm", true}};
struct Bounds {
  const char* name;
  TileBounds bounds;
};
constexpr Bounds kBounds[] = {
    {"square", TileBounds::square}, {"box", TileBounds::box}, {"exact", TileBounds::exact}};

// The tile lists of a pass, copied to the host.
struct HostLists {
  int tiles_x;
  std::vector<Splat> splats;
  std::vector<std::uint32_t> ranges, tile_splats;

  explicit HostLists(const RenderPass& pass)
      : tiles_x(pass.tiles_x), splats(pass.splats.download()), ranges(pass.tile_ranges.download()),
        tile_splats(pass.tile_splats.download()) {}
};

double relative_distance(double value, double threshold) { return std::abs(value / threshold - 1); }

// A pixel computed in double from the splats that both blenders read.
struct ExactPixel {
  Vec3d color;
  // The least relative change of one fragment's alpha that carries some fragment over a threshold.
  double borderline;
};

ExactPixel exact_pixel(const HostLists& lists, const RenderSettings& settings, int x, int y) {
  const bool is_classic = settings.blend_rule == BlendRule::classic;
  const std::size_t tile = std::size_t(y / kTileHeight) * lists.tiles_x + x / kTileWidth;
  PixelState<double> state;
  double borderline = std::numeric_limits<double>::infinity();
  // Relative effect of an alpha on the transmittance: large for an opaque fragment.
  double leverage = 1;
  for (std::uint32_t k = lists.ranges[tile]; k < lists.ranges[tile + 1]; ++k) {
    const Splat& splat = lists.splats[gaussian_of(lists.tile_splats[k])];
    const Sym2<double> conic{splat.conic.xx, splat.conic.xy, splat.conic.yy};
    const auto L = conic_factors(conic, double(splat.variance_y));
    const double dx = x + 0.5 - splat.mean2d.x, dy = y + 0.5 - splat.mean2d.y;
    const double u_x = L.xx * dx + L.xy * dy, u_y = L.yy * dy;
    double alpha = splat.opacity * std::exp2(-(u_x * u_x + u_y * u_y));
    borderline = std::min(borderline, relative_distance(alpha, kMinAlpha));
    if (alpha < kMinAlpha) continue;
    if (is_classic) alpha = std::min(alpha, double(kMaxAlphaClassic));
    const double after = state.transmittance * (1 - alpha);
    leverage = std::max(leverage, alpha / std::max(1 - alpha, 1e-12));
    borderline = std::min(borderline, std::abs(after - kMinTransmittance) / (after * leverage));
    const bool ends = is_opaque(after);
    if (ends && is_classic) break;
    composite(state, Vec3d(splat.color), alpha);
    if (ends) break;
  }
  return {state.color + state.transmittance * Vec3d(settings.background), borderline};
}

double largest_difference(const Vec3d& a, const Vec3d& b) {
  const Vec3d difference = a - b;
  return std::max({std::abs(difference.x), std::abs(difference.y), std::abs(difference.z)});
}

struct Difference {
  double squares = 0, largest = 0;
  std::size_t pixels = 0, apart = 0, unexplained = 0;
  double borderline = 0;
};

void add_difference(const RenderPass& expected, const RenderPass& actual,
                    const RenderSettings& settings, Difference& sum) {
  const std::vector<float> a = expected.image.download(), b = actual.image.download();
  const std::size_t plane = expected.pixel_count();
  std::vector<std::size_t> apart;
  for (std::size_t i = 0; i < plane; ++i) {
    double farthest = 0;
    for (int c = 0; c < 3; ++c) {
      double difference = std::abs(double(a[c * plane + i]) - b[c * plane + i]);
      if (std::isnan(difference)) difference = std::numeric_limits<double>::infinity();
      sum.squares += difference * difference;
      farthest = std::max(farthest, difference);
    }
    sum.largest = std::max(sum.largest, farthest);
    if (!(farthest <= kBlendersAgree)) apart.push_back(i);
  }
  sum.pixels += plane;
  sum.apart += apart.size();
  if (apart.empty()) return;
  const HostLists lists(expected);
  std::vector<char> is_unexplained(apart.size());
  std::vector<double> borderlines(apart.size());
  parallel_for(apart.size(), 16, [&](std::size_t k) {
    const std::size_t i = apart[k];
    const ExactPixel exact =
        exact_pixel(lists, settings, int(i % expected.width), int(i / expected.width));
    const double error = largest_difference(exact.color, {b[i], b[plane + i], b[2 * plane + i]});
    is_unexplained[k] = exact.borderline >= kBorderline && !(error <= kBlendersAgree);
    borderlines[k] = exact.borderline;
  });
  for (std::size_t k = 0; k < apart.size(); ++k) {
    if (!is_unexplained[k]) continue;
    ++sum.unexplained;
    sum.borderline = std::max(sum.borderline, borderlines[k]);
  }
}

}  // namespace

std::vector<BlenderFigures> compare_blenders(Backend& backend, TrainingModel& model,
                                             const std::vector<View>& views,
                                             const RenderSettings& settings,
                                             const BenchmarkPlan& plan) {
  std::vector<BlenderFigures> all;
  RenderPass expected(backend.memory()), actual(backend.memory());
  for (const double scale : plan.scales)
    for (const Bounds& bounds : kBounds)
      for (const Blender& blender : kBlenders) {
        log_info("blenders: {}, {} at scale {:g}", bounds.name, blender.name, scale);
        RenderSettings simt = settings;
        simt.bounds = bounds.bounds;
        simt.for_backward = simt.use_tensor_cores = false;
        RenderSettings own = simt;
        own.use_tensor_cores = blender.use_tensor_cores;
        const RenderingFigures timed =
            time_rendering(backend, model, views, own, plan, scale, FrameSource::parameters);

        BlenderFigures figures{bounds.name, blender.name, scale, timed.width, timed.height};
        figures.instances = timed.mean.instances;
        figures.ms_per_frame = timed.ms_per_frame;
        for (const StageFigures& stage : timed.stages)
          if (stage.stage == "blend") figures.blend_ms = stage.milliseconds;
        Difference difference;
        for (const View& view : views) {
          const Camera camera = at_scale(view.camera, scale);
          backend.renderer().forward(model.gaussians.span(), camera, simt, expected);
          backend.renderer().forward(model.gaussians.span(), camera, own, actual);
          add_difference(expected, actual, own, difference);
        }
        figures.psnr = difference.squares > 0
                           ? -10 * std::log10(difference.squares / double(3 * difference.pixels))
                           : std::numeric_limits<double>::infinity();
        figures.largest = difference.largest;
        figures.pixels = difference.pixels;
        figures.apart = difference.apart;
        figures.unexplained = difference.unexplained;
        figures.borderline = difference.borderline;
        all.push_back(figures);
      }
  return all;
}

}  // namespace gs
