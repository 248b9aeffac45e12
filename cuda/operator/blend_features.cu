// SPDX-License-Identifier: Apache-2.0
// Stages 4 and 6 for features: any number of channels beside the color, blended as they are.
//
//   F(pixel) = sum_i w_i phi_i       q_i = <phi_i, dL/dF>       dL/dphi_i = sum_pixels w_i dL/dF
//
// All three are matrix products, for 16 splats and 32 channels at a time:
//
//   F         [pixels x splats] [splats x channels]
//   q         [splats x channels] [channels x pixels]
//   dL/dphi   [splats x pixels] [pixels x channels]
//
// The colors have been blended before, so that the last fragment of each pixel is known. A warp has a
// sub-tile and 32 channels, and walks the list of the tile once. Of a lane's pixel, the weights and
// what dL/d(alpha) needs are numbers, not vectors: q takes the place of a color's share. Gradients
// of splats by different channels add up. Left- and right-hand sides are both split into two TF32
// parts.
#include "cuda/operator/stages.cuh"
#include "cuda/render/blend/fragment_products.cuh"

namespace gs::cuda {
namespace {

constexpr int kThreads = 64;
constexpr int kWarps = kThreads / kWarp;
constexpr int kMomentStride = 12;        // floats, from one splat's moments to the next one's
constexpr int kPixelStride = kWarp + 2;  // floats; a channel of all pixels
constexpr int kVector = sizeof(float4) / sizeof(float);

using Walk = PartWalkOf<Splat, kTileWidth, true>;

/// Features and what belongs to them, in rows of `channels` numbers, a multiple of four.
struct Features {
  const float* of_gaussian;  // (N, channels)
  int channels;
  const std::uint32_t* last;  // (H, W)

  /// Four channels from the first on of a Gaussian, 0 beyond the last one and where there is no
  /// number.
  __device__ float4 of(std::uint32_t gaussian, int first) const {
    return four(of_gaussian + std::size_t(gaussian) * channels, first);
  }
  __device__ float4 four(const float* row, int first) const {
    if (first >= channels) return {0, 0, 0, 0};
    const float4 v = __ldg(reinterpret_cast<const float4*>(row + first));
    return {finite(v.x), finite(v.y), finite(v.z), finite(v.w)};
  }

 private:
  __device__ static float finite(float x) { return x - x == 0.0f ? x : 0.0f; }
};

struct WarpShared {
  ListedSplat list[kListed];
  Walk::Ahead ahead;
  // left-hand sides: f and w of 16 splats at each pixel; then the moments of each splat
  alignas(16) float fragments[place_of_w(kProducts - 1) + kLeftStride];
};
template <int kChannels>
struct BackwardShared : WarpShared {
  alignas(8) float dL_dF[kChannels][kPixelStride];
};

/// How many warps share the channels of a sub-tile, so many each.
__host__ __device__ inline int shares_of(int channels, int of_warp) {
  return (channels + of_warp - 1) / of_warp;
}
/// The warp's sub-tile and its first channel.
struct Work {
  std::uint32_t item;
  int subtile, first_channel;

  __device__ Work(const Features& features, int of_warp) {
    const unsigned shares = unsigned(shares_of(features.channels, of_warp));
    const unsigned warp = blockIdx.x / shares * kWarps + threadIdx.x / kWarp;
    item = warp / kSubtilesPerTile;
    subtile = int(warp % kSubtilesPerTile);
    first_channel = int(blockIdx.x % shares) * of_warp;
  }
};

/// One lane's pixel on its way through the list.
struct PixelWeights {
  float x, y, transmittance = 1;
  int last = -1;  // the position of the last fragment

  __device__ PixelWeights(const TileLists& lists, const Subtile& subtile, const Features& features)
      : x(float(subtile.x) + 0.5f), y(float(subtile.y) + 0.5f) {
    if (subtile.is_inside) last = int(features.last[subtile.pixel(lists)]) - 1;
  }

  struct Fragment {
    float alpha, weight;
    bool is_clamped;
  };
  /// The next fragment. One that is not kept has alpha and weight 0.
  template <BlendRule rule>
  __device__ Fragment next(const ListedSplat& splat) {
    const float e = base2_exponent(splat, x - splat.mean2d.x, y - splat.mean2d.y);
    const bool is_kept = e >= splat.lowest && int(splat.position) <= last;
    const float opacity = is_kept ? splat.opacity : 0.0f, gaussian = exp2_fragment(e);
    Fragment fragment;
    fragment.alpha = fragment_alpha<rule>(opacity, gaussian);
    fragment.weight = transmittance * fragment.alpha;
    fragment.is_clamped =
        rule == BlendRule::classic && opacity * gaussian > float(kMaxAlphaClassic);
    transmittance *= 1.0f - fragment.alpha;
    return fragment;
  }
};

/// The whole warp: calls f(list, count) for each next 16 splats of the list up to `longest`, and for
/// the last ones. Splats beyond count are empty.
template <class F>
__device__ void for_each_product(WarpShared& shared, const TileLists& lists, const Subtile& subtile,
                                 std::uint32_t longest, const F& f) {
  const PixelRange pixels = subtile.pixels();
  Walk walk(shared.ahead, lists, subtile.tile, pixels.bit(), 0, longest, false);
  ListedSplat* list = shared.list;  // where the next product begins
  int listed = 0;                   // splats from there on
  while (true) {
    while (listed < kProductSplats && !walk.is_done())
      listed += list_next(shared.list, int(list - shared.list) + listed, walk, pixels);
    if (listed == 0) return;
    const int count = min(listed, kProductSplats);
    if (lane_of_thread() >= count && lane_of_thread() < kProductSplats)
      list[lane_of_thread()] = {};  // nothing of it is kept
    __syncwarp();
    f(list, count);
    __syncwarp();
    listed -= count;
    list = list + kProductSplats < shared.list + kListed ? list + kProductSplats : shared.list;
  }
}

/// A lane of the forward pass has the columns kTiles g + j of splats, and of pixels g, g + 8, ... the
/// channels from 2 kTiles t on.
template <BlendRule rule, int kChannels>
__global__ void __launch_bounds__(kThreads)
    blend_features_kernel(TileLists lists, const std::uint32_t* tile_order, Features features,
                          float* to) {
  constexpr int kTiles = kChannels / 8;
  __shared__ WarpShared shared_of_warps[kWarps];
  WarpShared& shared = shared_of_warps[threadIdx.x / kWarp];
  const Work work(features, kChannels);
  const Subtile subtile(lists, tile_of(tile_order, work.item), work.subtile);
  if (subtile.x0 >= lists.width || subtile.y0 >= lists.height) return;  // the whole warp
  const int lane = lane_of_thread(), g = lane / 4, t = lane % 4;
  PixelWeights pixel(lists, subtile, features);
  float* const left = shared.fragments + place_of_w(lane / 8) + 2 * (lane % 8);
  float sums[2][kTiles][4] = {};
  const std::uint32_t longest = warp_max(std::uint32_t(pixel.last + 1));
  for_each_product(shared, lists, subtile, longest, [&](const ListedSplat* list, int count) {
    float columns[2][2][kTiles];  // of splats 8 s + 2 t and the next one
#pragma unroll
    for (int s = 0; s < 2; ++s)
#pragma unroll
      for (int k = 0; k < 2; ++k) {
        const int splat = 8 * s + 2 * t + k;
        const int first = work.first_channel + kTiles * g;
        const float4 of = splat < count
                              ? features.of(list[splat].gaussian, first / kVector * kVector)
                              : float4{0, 0, 0, 0};
        if constexpr (kTiles == kVector) {
          columns[s][k][0] = of.x, columns[s][k][1] = of.y;
          columns[s][k][2] = of.z, columns[s][k][3] = of.w;
        } else if constexpr (kTiles == 2) {
          columns[s][k][0] = g % 2 ? of.z : of.x, columns[s][k][1] = g % 2 ? of.w : of.y;
        } else {
          const float x = g % 2 ? of.y : of.x, z = g % 2 ? of.w : of.z;
          columns[s][k][0] = g % kVector / 2 ? z : x;
        }
      }
#pragma unroll 1
    for (int k = 0; k < kProductSplats; k += 2) {
      const float a = pixel.template next<rule>(list[k]).weight;
      const float b = pixel.template next<rule>(list[k + 1]).weight;
      *reinterpret_cast<float2*>(left + k / 2 * kPairStride) = {a, b};
    }
    __syncwarp();
#pragma unroll
    for (int half = 0; half < 2; ++half)
#pragma unroll
      for (int s = 0; s < 2; ++s) {
        const float* const rows = shared.fragments + (4 * s + t) * kPairStride + 2 * g;
        const float2 top = *reinterpret_cast<const float2*>(rows + place_of_w(2 * half));
        const float2 bottom = *reinterpret_cast<const float2*>(rows + place_of_w(2 * half + 1));
#pragma unroll
        for (int j = 0; j < kTiles; ++j)
          multiply_add_both_in_parts(sums[half][j], {top.x, bottom.x, top.y, bottom.y},
                                     {columns[s][0][j], columns[s][1][j]});
      }
  });
  const int channel = work.first_channel + 2 * kTiles * t;
#pragma unroll
  for (int half = 0; half < 2; ++half)
#pragma unroll
    for (int r = 0; r < 2; ++r) {  // pixels 16 half + 8 r + g: a row of the sub-tile
      const int x = subtile.x0 + g, y = subtile.y0 + 2 * half + r;
      if (x >= lists.width || y >= lists.height) continue;
      float* const row = to + (std::size_t(y) * lists.width + x) * features.channels;
      if constexpr (kTiles == 1) {
        if (channel < features.channels)
          *reinterpret_cast<float2*>(row + channel) = {sums[half][0][2 * r],
                                                       sums[half][0][2 * r + 1]};
      } else {
#pragma unroll
        for (int k = 0; k < 2 * kTiles; k += kVector) {
          const auto sum = [&](int i) { return sums[half][i % kTiles][2 * r + i / kTiles]; };
          if (channel + k < features.channels)
            *reinterpret_cast<float4*>(row + channel + k) = {sum(k), sum(k + 1), sum(k + 2),
                                                             sum(k + 3)};
        }
      }
    }
}

/// What the backward pass reads and where it adds.
struct Gradients {
  const float *F, *dL_dF;           // (H, W, channels)
  SplatGradientSum* splats;         // (N)
  float* features;                  // (N, channels)  may be null
  const std::uint32_t* overflowed;  // (1)  may be null; where it is raised, nothing is added
};

/// Four channels of a splat, unless they are zero.
__device__ inline void add_four(float* to, const float (&v)[4]) {
  if (v[0] != 0.0f || v[1] != 0.0f || v[2] != 0.0f || v[3] != 0.0f)
    add_to(reinterpret_cast<float4*>(to), {v[0], v[1], v[2], v[3]});
}

template <BlendRule rule, int kChannels, bool kAbsolute>
__global__ void __launch_bounds__(kThreads)
    blend_features_backward_kernel(TileLists lists, const std::uint32_t* tile_order,
                                   Features features, Gradients gradients) {
  constexpr int kTiles = kChannels / 8;
  __shared__ BackwardShared<kChannels> shared_of_warps[kWarps];
  BackwardShared<kChannels>& shared = shared_of_warps[threadIdx.x / kWarp];
  if (gradients.overflowed && *gradients.overflowed) return;
  const Work work(features, kChannels);
  const Subtile subtile(lists, tile_of(tile_order, work.item), work.subtile);
  if (subtile.x0 >= lists.width || subtile.y0 >= lists.height) return;  // the whole warp
  const int lane = lane_of_thread(), g = lane / 4, t = lane % 4;
  PixelWeights pixel(lists, subtile, features);
  const std::uint32_t longest = warp_max(std::uint32_t(pixel.last + 1));
  if (longest == 0) return;
  float behind = 0;  // <features behind, dL/dF>
  const std::size_t of_pixel = subtile.pixel(lists) * features.channels;
  for (int k = 0; k < kChannels; k += kVector) {
    const int first = work.first_channel + k;
    float4 dL{0, 0, 0, 0};
    if (subtile.is_inside && first < features.channels) {
      dL = *reinterpret_cast<const float4*>(gradients.dL_dF + of_pixel + first);
      const float4 F = *reinterpret_cast<const float4*>(gradients.F + of_pixel + first);
      behind = fmaf(F.x, dL.x, fmaf(F.y, dL.y, fmaf(F.z, dL.z, fmaf(F.w, dL.w, behind))));
    }
    shared.dL_dF[k][lane] = dL.x, shared.dL_dF[k + 1][lane] = dL.y;
    shared.dL_dF[k + 2][lane] = dL.z, shared.dL_dF[k + 3][lane] = dL.w;
  }
  __syncwarp();
  const Monomials monomials;
  const Vec2f center{float(subtile.x0) + 0.5f * kSubtileWidth,
                     float(subtile.y0) + 0.5f * kSubtileHeight};
  const int place = place_of_f(lane / 8) + 2 * (lane % 8);
  for_each_product(shared, lists, subtile, longest, [&](const ListedSplat* list, int count) {
    // q of all pixels, where w will be. Rows g and g + 8 are splats 2 g and 2 g + 1.
    float q[kProducts][4] = {};
    if constexpr (kTiles == 1) {  // a lane has the channels 2 t and 2 t + 1
      const auto pair = [&](int splat) -> float2 {
        if (splat >= count) return {0, 0};
        const float4 of = features.of(list[splat].gaussian, 2 * t / kVector * kVector);
        return t % 2 ? float2{of.z, of.w} : float2{of.x, of.y};
      };
      const float2 one = pair(2 * g), two = pair(2 * g + 1);
#pragma unroll
      for (int n = 0; n < kProducts; ++n) {
        const float* const column = &shared.dL_dF[2 * t][8 * n + g];
        multiply_add_both_in_parts(q[n], {one.x, two.x, one.y, two.y},
                                   {column[0], column[kPixelStride]});
      }
    }
#pragma unroll
    for (int part = 0; part < kChannels / 16; ++part) {
      const int first = 16 * part + kVector * t;
      const float4 zero{0, 0, 0, 0};
      const float4 one =
          2 * g < count ? features.of(list[2 * g].gaussian, work.first_channel + first) : zero;
      const float4 two = 2 * g + 1 < count
                             ? features.of(list[2 * g + 1].gaussian, work.first_channel + first)
                             : zero;
#pragma unroll
      for (int n = 0; n < kProducts; ++n) {
        const float* const column = &shared.dL_dF[first][8 * n + g];
        multiply_add_both_in_parts(q[n], {one.x, two.x, one.y, two.y},
                                   {column[0], column[kPixelStride]});
        multiply_add_both_in_parts(q[n], {one.z, two.z, one.w, two.w},
                                   {column[2 * kPixelStride], column[3 * kPixelStride]});
      }
    }
#pragma unroll
    for (int n = 0; n < kProducts; ++n)
      *reinterpret_cast<float4*>(shared.fragments + place_of_w(n) + 4 * lane) = {q[n][0], q[n][2],
                                                                                 q[n][1], q[n][3]};
    __syncwarp();
    Vec2f absolute{0, 0};  // of splat `lane`
    const auto step = [&](int k, float shade) {
      const ListedSplat& splat = list[k];
      const auto fragment = pixel.template next<rule>(splat);
      const float share = fragment.weight * shade;
      behind = int(splat.position) == pixel.last ? 0.0f : behind - share;
      const float left = 1.0f / fmaxf(1.0f - fragment.alpha, kMinOneMinusAlpha);
      const float f = fragment.is_clamped ? 0.0f : fmaf(-fragment.alpha * left, behind, share);
      if constexpr (kAbsolute) {
        const Vec2f sum =
            absolute_gradient(splat, pixel.x - splat.mean2d.x, pixel.y - splat.mean2d.y, f);
        if (lane == k) absolute = sum;
      }
      return float2{f, fragment.weight};
    };
#pragma unroll 1
    for (int k = 0; k < kProductSplats; k += 2) {
      float* const at = shared.fragments + place + k / 2 * kPairStride;
      const float2 shades = *reinterpret_cast<const float2*>(at + place_of_w(0));
      const float2 a = step(k, shades.x), b = step(k + 1, shades.y);
      *reinterpret_cast<float2*>(at) = {a.x, b.x};
      *reinterpret_cast<float2*>(at + place_of_w(0)) = {a.y, b.y};
    }
    __syncwarp();
    float moments[4] = {}, sums[kTiles][4] = {};
#pragma unroll
    for (int n = 0; n < kProducts; ++n) {
      const float4 f =
          *reinterpret_cast<const float4*>(shared.fragments + place_of_f(n) + 4 * lane);
      const float4 w =
          *reinterpret_cast<const float4*>(shared.fragments + place_of_w(n) + 4 * lane);
      const float y = monomials.y_of_row(n);
      multiply_add_exactly(moments, {f.x, f.y, f.z, f.w}, {monomials.x[0] * y, monomials.x[1] * y});
      if (gradients.features)
#pragma unroll
        for (int j = 0; j < kTiles; ++j) {
          const float2 dL =
              *reinterpret_cast<const float2*>(&shared.dL_dF[kTiles * g + j][8 * n + 2 * t]);
          multiply_add_both_in_parts(sums[j], {w.x, w.y, w.z, w.w}, {dL.x, dL.y});
        }
    }
    if (kTiles == 1 && gradients.features) {
      // Even lanes take splat 2 g and odd ones the next: each has two channels, and gets two.
      const bool is_odd = t % 2;
      const float(&of)[4] = sums[0];
      const float a = is_odd ? of[2] : of[0], b = is_odd ? of[3] : of[1];
      const float c = __shfl_xor_sync(kAllLanes, is_odd ? of[0] : of[2], 1);
      const float d = __shfl_xor_sync(kAllLanes, is_odd ? of[1] : of[3], 1);
      const int splat = 2 * g + is_odd, channel = t / 2 * kVector;
      if (splat < count && channel < features.channels) {
        float* const row =
            gradients.features + std::size_t(list[splat].gaussian) * features.channels;
        if (is_odd)
          add_four(row + channel, {c, d, a, b});
        else
          add_four(row + channel, {a, b, c, d});
      }
    }
    if (kTiles > 1 && gradients.features)
#pragma unroll
      for (int r = 0; r < 2; ++r) {
        const int splat = 2 * g + r;
        if (splat >= count) continue;
        const int channel = work.first_channel + 2 * kTiles * t;
        float* const row =
            gradients.features + std::size_t(list[splat].gaussian) * features.channels;
#pragma unroll
        for (int k = 0; k < 2 * kTiles; k += kVector) {
          const auto sum = [&](int i) { return sums[i % kTiles][2 * r + i / kTiles]; };
          if (channel + k < features.channels)
            add_four(row + channel + k, {sum(k), sum(k + 1), sum(k + 2), sum(k + 3)});
        }
      }
    __syncwarp();
    float* const to = shared.fragments + 2 * g * kMomentStride + 2 * t;
    *reinterpret_cast<float2*>(to) = {moments[0], moments[1]};
    *reinterpret_cast<float2*>(to + kMomentStride) = {moments[2], moments[3]};
    __syncwarp();
    if (lane >= count) return;
    const ListedSplat splat = list[lane];
    const SplatGradientSum sum =
        splat_gradient(splat, center, shared.fragments + lane * kMomentStride);
    float* const into = reinterpret_cast<float*>(gradients.splats + splat.gaussian);
    add_four(into, {sum.mean2d.x, sum.mean2d.y, sum.conic_xx, sum.conic_xy});
    add_four(into + 4, {sum.conic_yy, sum.opacity, 0.0f, 0.0f});
    if constexpr (kAbsolute) add_four(into + 8, {0.0f, absolute.x, absolute.y, 0.0f});
  });
}

/// Calls f with the number of channels that a warp takes, and the blocks.
template <class F>
void with_channels(const RenderPass& pass, int channels, const F& f) {
  const std::size_t blocks = pass.tile_count() * kSubtilesPerTile / kWarps;
  if (channels <= 8)
    f(std::integral_constant<int, 8>(), blocks);
  else if (channels <= 16)
    f(std::integral_constant<int, 16>(), blocks);
  else
    f(std::integral_constant<int, 32>(), blocks * std::size_t(shares_of(channels, 32)));
}

}  // namespace

void blend_features(Context& context, const RenderSettings& settings, const RenderPass& pass,
                    const OperatorInput& input, float* to) {
  const Features features{input.features, input.channels, pass.last_instance.data()};
  with_channels(pass, input.channels, [&](auto channels, std::size_t blocks) {
    with_rule(settings.blend_rule, [&](auto rule) {
      context.launch("features", blend_features_kernel<rule(), channels()>, blocks, kThreads,
                     tile_lists(pass), pass.scratch<CudaScratch>().order(), features, to);
    });
  });
}

void blend_features_backward(Context& context, const RenderSettings& settings,
                             const RenderPass& pass, const OperatorInput& input,
                             const OperatorPictureGradient& dL, const std::uint32_t* overflowed,
                             Workspace& workspace, float* to) {
  const Features features{input.features, input.channels, pass.last_instance.data()};
  const Gradients gradients{dL.drawn_features, dL.features, workspace.splat_gradients.data(), to,
                            overflowed};
  with_channels(pass, input.channels, [&](auto channels, std::size_t blocks) {
    with_rule(settings.blend_rule, [&](auto rule) {
      with_constant(settings.absolute_gradient, [&](auto absolute) {
        context.launch("features backward",
                       blend_features_backward_kernel<rule(), channels(), absolute()>, blocks,
                       kThreads, tile_lists(pass), pass.scratch<CudaScratch>().order(), features,
                       gradients);
      });
    });
  });
}

}  // namespace gs::cuda
