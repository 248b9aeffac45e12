// SPDX-License-Identifier: Apache-2.0
// Stage 6: the gradients of blending, front to back again. subtile.cuh describes the work of a
// warp.
//
// A lane goes through the listed splats for its pixel and computes two numbers for each: f = dL/dE,
// the gradient by the exponent, and w = T alpha, the weight. The gradient of a splat follows from
// sums of these over the pixels:
//
//   sum f {1, x, y, x^2, x y, y^2}   for mean, conic and opacity; x, y from the sub-tile's center
//   sum w dL/d(pixel)                for its color
//
// These are two matrix products, [splats x pixels] [pixels x 6] and [splats x pixels] [pixels x 3],
// on tensor cores for 16 splats at a time. x and y are multiples of 1/2 below 4, so that the first
// right-hand side is exact in TF32. The left-hand sides are split into two TF32 parts, so that only
// the sums are rounded.
//
// Scores of density control that sum over fragments (FragmentSums) cost little more. sum f is one
// of the moments, and sum w v is another column of the colors, with a value v of each pixel. The
// rest is summed from the registers that the products load.
#include "cuda/device/mma.cuh"
#include "cuda/render/subtile.cuh"
#include "cuda/stages.cuh"

namespace gs::cuda {
namespace {

constexpr int kBlocks = 7;                  // per multiprocessor, as many as registers allow
constexpr int kBlocksAbsolute = 6;          // the same with absolute gradients
constexpr int kBlocksFragments = 6;         // the same with sums over fragments
constexpr int kRows = 16;                   // splats of one product
constexpr int kRowStride = 2 * kWarp + 16;  // floats; rows lie 16 banks apart, for 16-byte loads
constexpr int kProducts = kWarp / 8;        // of 8 pixels each
constexpr int kSumStride = 20;              // floats from one splat's sums to the next
constexpr int kSecondAt = 16;               // the place of FragmentSums::second among them

struct WarpShared {
  ListedSplat list[kWarp];
  ListWalk::Ahead ahead;
  alignas(16) float rows[kRows * kRowStride];  // f and w of each pixel, one splat a row; then sums
  float2 colors[kProducts][kWarp];             // right-hand side of the colors: each lane's part
  alignas(8) float values[kWarp];              // v of each pixel
};

// This lane's part of the right-hand side of the moments, column l / 4: x^a y^b, a + b <= 2. Row t
// of product q is pixel 8 q + 2 t of the sub-tile, and row t + 4 is the next pixel, so that a lane
// reads f and w of both in 16 consecutive bytes.
struct Monomials {
  float x[2];        // x^a of the columns 2 t and 2 t + 1
  float y[2], sign;  // y^b of the first two rows; times `sign`, mirrored, of the last two

  __device__ Monomials() {
    static_assert(kSubtileWidth == 8 && kSubtileHeight == kProducts && kProducts == 4);
    const int column = lane_of_thread() / 4, t = lane_of_thread() % 4;
    const int a = column == 3 ? 2 : column == 1 || column == 4 ? 1 : 0;
    const int b = column == 5 ? 2 : column == 2 || column == 4 ? 1 : 0;
    for (int k = 0; k < 2; ++k) {
      x[k] = power(float(2 * t + k) - 3.5f, a) * (column < 6 ? 1.0f : 0.0f);
      y[k] = power(float(k) - 1.5f, b);
    }
    sign = b == 1 ? -1.0f : 1.0f;
  }
  __device__ float y_of_row(int q) const { return q < 2 ? y[q] : sign * y[3 - q]; }

 private:
  __device__ static float power(float base, int n) {
    return n == 0 ? 1.0f : n == 1 ? base : base * base;
  }
};

// The whole warp: writes the right-hand side of the colors: columns r, g, b of dL/d(pixel) in TF32,
// then the rest of each, then those of v.
__device__ void stage_colors(WarpShared& shared, const Vec3f& dL_dpixel, float value) {
  const int lane = lane_of_thread(), column = lane / 4, t = lane % 4;
  shared.values[lane] = value;
  __syncwarp();
  for (int q = 0; q < kProducts; ++q) {
    float part[2];
    for (int k = 0; k < 2; ++k) {
      const int pixel = 8 * q + 2 * t + k;
      const float red = __shfl_sync(kAllLanes, dL_dpixel.x, pixel);
      const float green = __shfl_sync(kAllLanes, dL_dpixel.y, pixel);
      const float blue = __shfl_sync(kAllLanes, dL_dpixel.z, pixel);
      const float number = column >= 6       ? shared.values[pixel]
                           : column % 3 == 0 ? red
                           : column % 3 == 1 ? green
                                             : blue;
      const float high = tf32_part(number);
      part[k] = column < 3 || column == 6 ? high : number - high;
    }
    shared.colors[q][lane] = {part[0], part[1]};
  }
}

// dL/d(splat) from the sums over the pixels of one sub-tile. preprocess_backward() masks the colors
// later.
__device__ SplatGradientSum splat_gradient(const ListedSplat& splat, const Vec2f& center,
                                           const float* sums) {
  const float4 a = *reinterpret_cast<const float4*>(sums);
  const float4 b = *reinterpret_cast<const float4*>(sums + 4);
  const float4 c = *reinterpret_cast<const float4*>(sums + 8);
  const float4 d = *reinterpret_cast<const float4*>(sums + 12);
  // From moments about the sub-tile's center to moments about the splat's mean.
  const float f = a.x, mx = splat.mean2d.x - center.x, my = splat.mean2d.y - center.y;
  const float fx = a.y - mx * f, fy = a.z - my * f;
  const float fxx = a.w - mx * (a.y + fx), fxy = b.x - mx * a.z - my * fx,
              fyy = b.y - my * (a.z + fy);
  const Sym2<float> Q = conic_of(splat.L);
  return {{Q.xx * fx + Q.xy * fy, Q.xy * fx + Q.yy * fy},  -0.5f * fxx, -0.5f * fxy, -0.5f * fyy,
          splat.opacity > 0.0f ? f / splat.opacity : 0.0f, c.x + c.w,   c.y + d.x,   c.z + d.y};
}

// The whole warp: |dL/d(mean)| of a splat summed over its pixels, axis by axis, from each one's f
// at d = (dx, dy).
__device__ Vec2f absolute_gradient(const ListedSplat& splat, float dx, float dy, float f) {
  const Sym2<float> Q = conic_of(splat.L);
  return {warp_sum(fabsf(f * (Q.xx * dx + Q.xy * dy))),
          warp_sum(fabsf(f * (Q.xy * dx + Q.yy * dy)))};
}

// What a sub-tile adds to one Gaussian.
struct SplatShare {
  SplatGradientSum gradient;
  FragmentSums fragments;
};

// The sums of the gradients of all Gaussians, in floating point or in fixed point. add() is called
// by the whole warp: lane r < count has the share of row r's splat, and scratch memory from
// numbers[r * kSumStride] on.
template <bool kAbsolute_>
struct FloatSums {
  static constexpr bool kAbsolute = kAbsolute_;
  static constexpr FragmentStatistic kStatistic = FragmentStatistic::none;
  SplatGradientSum* of_gaussian;

  __device__ void add(int count, std::uint32_t gaussian, const SplatShare& share, float*) const {
    if (lane_of_thread() >= count) return;
    const SplatGradientSum& sum = share.gradient;
    float4* const into = reinterpret_cast<float4*>(of_gaussian + gaussian);
    add_to(into, {sum.mean2d.x, sum.mean2d.y, sum.conic_xx, sum.conic_xy});
    add_to(into + 1, {sum.conic_yy, sum.opacity, sum.red, sum.green});
    if (kAbsolute)
      add_to(into + 2, {sum.blue, sum.absolute_x, sum.absolute_y, 0.0f});
    else
      atomicAdd(&of_gaussian[gaussian].blue, sum.blue);
  }
};
// With the score "force": count and second of FragmentSums are in place of absolute gradients.
// sum f follows from the gradient by the opacity (gather_forces_kernel()).
struct FloatSumsOfForces : FloatSums<true> {
  static constexpr bool kAbsolute = false;
  static constexpr FragmentStatistic kStatistic = FragmentStatistic::force;

  __device__ void add(int count, std::uint32_t gaussian, SplatShare share, float* numbers) const {
    share.gradient.absolute_x = share.fragments.count;
    share.gradient.absolute_y = share.fragments.second;
    FloatSums<true>::add(count, gaussian, share, numbers);
  }
};
template <bool kAbsolute_>
struct FixedSums {
  static constexpr bool kAbsolute = kAbsolute_;
  static constexpr FragmentStatistic kStatistic = FragmentStatistic::none;
  FineSums* fine;
  CoarseSums* coarse;

  // Neighboring lanes add neighboring numbers, which share sectors of memory.
  __device__ void add(int count, std::uint32_t gaussian, const SplatShare& share,
                      float* numbers) const {
    constexpr int kNumbers = kAbsolute ? kAllGradientNumbers : kGradientNumbers;
    const int lane = lane_of_thread();
    if (lane < count)
      store_in_vectors(reinterpret_cast<SplatGradientSum*>(numbers + lane * kSumStride),
                       share.gradient);
    __syncwarp();
    for (int first = 0; first < count * kNumbers; first += kWarp) {
      const int k = first + lane, row = k / kNumbers, number = k % kNumbers;
      const std::uint32_t owner = __shfl_sync(kAllLanes, gaussian, row % kWarp);
      if (row < count)
        add_to(fine + owner, coarse + owner, number, numbers[row * kSumStride + number]);
    }
  }
};

// The same with sums over fragments, which go to memory of their own. They have kernels of their
// own, so that other steps do not pay for them.
template <class Sums, FragmentStatistic kStatistic_>
struct WithFragments : Sums {
  static constexpr FragmentStatistic kStatistic = kStatistic_;
  FragmentSink fragments;

  __device__ void add(int count, std::uint32_t gaussian, const SplatShare& share,
                      float* numbers) const {
    if (lane_of_thread() < count) fragments.add(gaussian, share.fragments);
    Sums::add(count, gaussian, share, numbers);
  }
};

// FragmentSums::second of two rows, g and g + 8, over the pixels that this lane loads.
template <FragmentStatistic statistic>
struct SecondSums {
  float top = 0, bottom = 0;

  // f and w of two neighboring pixels in both rows, and v of these pixels.
  __device__ void add(const float4& of_top, const float4& of_bottom, const float2& values) {
    if (statistic == FragmentStatistic::force) {
      top = fmaf(of_top.x, of_top.x, fmaf(of_top.z, of_top.z, top));
      bottom = fmaf(of_bottom.x, of_bottom.x, fmaf(of_bottom.z, of_bottom.z, bottom));
    } else if (statistic == FragmentStatistic::values) {
      top += (of_top.y > 0 ? values.x : 0.0f) + (of_top.w > 0 ? values.y : 0.0f);
      bottom += (of_bottom.y > 0 ? values.x : 0.0f) + (of_bottom.w > 0 ? values.y : 0.0f);
    }
  }
  /// The four lanes of a row: the sum over all pixels, of row g in even lanes and of g + 8 in odd
  /// ones.
  __device__ float total() const {
    const bool is_odd = lane_of_thread() % 2;
    const float given = __shfl_xor_sync(kAllLanes, is_odd ? top : bottom, 1);
    const float pair = (is_odd ? bottom : top) + given;
    return pair + __shfl_xor_sync(kAllLanes, pair, 2);
  }
};

// What lane r knows of row r's splat.
struct RowOfLane {
  int slot = 0;          // its place in the list
  Vec2f absolute{0, 0};  // its absolute gradient, where asked for
  unsigned kept = 0;     // the pixels of its fragments, a bit each, where asked for
};

// The whole warp: sums the first `count` rows over the pixels and adds each splat's share to the
// sums of its Gaussian.
template <class Sums>
__device__ void add_rows(WarpShared& shared, int count, const RowOfLane& row,
                         const Monomials& monomials, const Vec2f& center, const Sums& sums) {
  constexpr bool kHasFragments = Sums::kStatistic != FragmentStatistic::none;
  const int lane = lane_of_thread(), g = lane / 4, t = lane % 4;
  __syncwarp();
  SecondSums<Sums::kStatistic> seconds;
  float moments[4] = {}, colors[4] = {};
#pragma unroll
  for (int q = 0; q < kProducts; ++q) {
    const float* const at = shared.rows + g * kRowStride + 16 * q + 4 * t;
    const float4 top = *reinterpret_cast<const float4*>(at);
    const float4 bottom = *reinterpret_cast<const float4*>(at + 8 * kRowStride);
    const float y = monomials.y_of_row(q);
    const float2 color = shared.colors[q][lane];
    multiply_add_exactly(moments, {top.x, bottom.x, top.z, bottom.z},
                         {monomials.x[0] * y, monomials.x[1] * y});
    multiply_add_exactly(colors, {top.y, bottom.y, top.w, bottom.w}, {color.x, color.y});
    if (kHasFragments)
      seconds.add(top, bottom, *reinterpret_cast<const float2*>(shared.values + 8 * q + 2 * t));
  }
  [[maybe_unused]] const float second = kHasFragments ? seconds.total() : 0.0f;
  __syncwarp();
  float* const to = shared.rows + g * kSumStride + 2 * t;
  *reinterpret_cast<float2*>(to) = {moments[0], moments[1]};
  *reinterpret_cast<float2*>(to + 8) = {colors[0], colors[1]};
  *reinterpret_cast<float2*>(to + 8 * kSumStride) = {moments[2], moments[3]};
  *reinterpret_cast<float2*>(to + 8 * kSumStride + 8) = {colors[2], colors[3]};
  if (kHasFragments && t < 2) shared.rows[(g + 8 * t) * kSumStride + kSecondAt] = second;
  __syncwarp();
  std::uint32_t gaussian = 0;
  SplatShare share;
  if (lane < count) {
    const ListedSplat splat = shared.list[row.slot];
    const float* const of_row = shared.rows + lane * kSumStride;
    gaussian = splat.gaussian;
    share.gradient = splat_gradient(splat, center, of_row);
    if (Sums::kAbsolute)
      share.gradient.absolute_x = row.absolute.x, share.gradient.absolute_y = row.absolute.y;
    if (kHasFragments) {
      const bool is_force = Sums::kStatistic == FragmentStatistic::force;
      share.fragments = {float(__popc(row.kept)), is_force ? of_row[0] : of_row[14] + of_row[15],
                         of_row[kSecondAt]};
    }
  }
  sums.add(count, gaussian, share, shared.rows);
  __syncwarp();
}

// The state of one pixel during the walk. gs_core/math/blend.h has the same formulas with the color
// behind a fragment; here its inner product with dL/d(pixel) is enough.
struct PixelWalk {
  Vec3f dL_dpixel{0, 0, 0};
  float behind = 0;       // <color behind without background, dL/dpixel> - background_term
  float last_behind = 0;  // the same behind the last fragment: -background_term
  float transmittance = 1;
  std::uint32_t last = 0;

  __device__ PixelWalk(const TileLists& lists, const Subtile& subtile, const Vec3f& background,
                       const float* image, const float* final_transmittance,
                       const std::uint32_t* last_instance, const float* dL_dimage) {
    if (!subtile.is_inside) return;
    const std::size_t at = subtile.pixel(lists), plane = std::size_t(lists.width) * lists.height;
    dL_dpixel = {dL_dimage[at], dL_dimage[plane + at], dL_dimage[2 * plane + at]};
    behind = inner(dL_dpixel, Vec3f(image[at], image[plane + at], image[2 * plane + at]));
    last_behind = final_transmittance[at] * inner(dL_dpixel, background);
    last = last_instance[at];
  }

  /// Skips to a later segment; the checkpoint has (color, transmittance) before it.
  __device__ void skip_to(const Vec4f& checkpoint) {
    behind -= inner(dL_dpixel, Vec3f(checkpoint.x, checkpoint.y, checkpoint.z));
    transmittance = checkpoint.w;
  }

  /// Returns f and w of a fragment that is kept, and advances past it.
  template <BlendRule rule>
  __device__ float2 step(const ListedSplat& splat, float e) {
    const float gaussian = exp2_fragment(e);
    const float alpha = fragment_alpha<rule>(splat.opacity, gaussian);
    const float weight = transmittance * alpha;
    const float shade =
        fmaf(splat.red, dL_dpixel.x, fmaf(splat.green, dL_dpixel.y, splat.blue * dL_dpixel.z));
    behind = splat.position + 1 == last ? last_behind : fmaf(-weight, shade, behind);
    const float q = 1.0f / fmaxf(1.0f - alpha, kMinOneMinusAlpha);
    float f = fmaf(weight, shade, -alpha * q * behind);
    if (rule == BlendRule::classic && splat.opacity * gaussian > kMaxAlphaClassic) f = 0.0f;
    transmittance = transmittance * (1.0f - alpha);
    return {f, weight};
  }
};

// The results of the forward pass.
struct Forward {
  const float* image;                      // (3, H, W)
  const float* transmittance;              // (H, W)
  const std::uint32_t* last;               // (H, W)
  const std::uint32_t* first_checkpoints;  // (tiles)
  const Vec4f* checkpoints;                // (.., pixels of a tile)
};

template <class Sums>
constexpr int blocks_of() {
  if (Sums::kAbsolute) return kBlocksAbsolute;
  return Sums::kStatistic != FragmentStatistic::none ? kBlocksFragments : kBlocks;
}

template <BlendRule rule, class Sums>
__global__ void __launch_bounds__(kBlendThreads, blocks_of<Sums>())
    blend_backward_kernel(TileLists lists, const ListSegment* segments, Vec3f background,
                          Forward forward, const float* dL_dimage, Sums sums) {
  __shared__ WarpShared shared_of_warps[kBlendWarps];
  WarpShared& shared = shared_of_warps[threadIdx.x / kWarp];
  const int lane = lane_of_thread();
  const WarpWork work;
  const ListSegment segment = segments[work.item];
  if (segment.tile == kNoTile) return;
  const Subtile subtile(lists, segment.tile, work.subtile);
  PixelWalk pixel(lists, subtile, background, forward.image, forward.transmittance, forward.last,
                  dL_dimage);
  const std::uint32_t longest = warp_max(pixel.last), first = segment.number * kSegmentLength;
  if (longest <= first) return;
  if (segment.number > 0)
    pixel.skip_to(forward.checkpoints[subtile.checkpoint(forward.first_checkpoints[segment.tile] +
                                                         segment.number - 1)]);
  float value = 0;
  if constexpr (Sums::kStatistic == FragmentStatistic::values)
    if (subtile.is_inside) value = sums.fragments.values[subtile.pixel(lists)];
  stage_colors(shared, pixel.dL_dpixel, value);
  const Monomials monomials;
  const Vec2f center{float(subtile.x0) + 0.5f * kSubtileWidth,
                     float(subtile.y0) + 0.5f * kSubtileHeight};
  const float x = float(subtile.x) + 0.5f, y = float(subtile.y) + 0.5f;
  for (ListWalk walk(shared.ahead, lists, subtile.tile, subtile.pixels(), first,
                     min(longest, first + kSegmentLength), false);
       !walk.is_done();) {
    const int count = walk.list_next(shared.list);
    int rows = 0;
    RowOfLane row;
    for (int i = 0; i < count; ++i) {
      const ListedSplat splat = shared.list[i];
      const float dx = x - splat.mean2d.x, dy = y - splat.mean2d.y;
      const float e = base2_exponent(splat, dx, dy);
      const bool keep = e >= splat.lowest && splat.position < pixel.last;
      const unsigned kept = __ballot_sync(kAllLanes, keep);
      if (!kept) continue;
      float2 fragment{0.0f, 0.0f};
      if (keep) fragment = pixel.step<rule>(splat, e);
      *reinterpret_cast<float2*>(shared.rows + rows * kRowStride + 2 * lane) = fragment;
      if (Sums::kAbsolute) {
        const Vec2f sum = absolute_gradient(splat, dx, dy, fragment.x);
        if (lane == rows) row.absolute = sum;
      }
      if (lane == rows) row.slot = i, row.kept = kept;
      if (++rows == kRows) {
        add_rows(shared, rows, row, monomials, center, sums);
        rows = 0;
      }
    }
    if (rows) add_rows(shared, rows, row, monomials, center, sums);
    __syncwarp();
  }
}

// Adds the fixed-point sums of visible Gaussians to the floats that preprocess_backward() reads,
// which are zero but for photos with a depth map, and clears them.
__global__ void __launch_bounds__(kBlendThreads)
    collect_sums_kernel(std::size_t count, const std::uint32_t* tile_counts, FineSums* all_fine,
                        CoarseSums* all_coarse, SplatGradientSum* gradients) {
  const std::size_t i = std::size_t(blockIdx.x) * kBlendThreads + threadIdx.x;
  if (i >= count || tile_counts[i] == 0) return;
  const FineSums fine = load_in_vectors(all_fine + i);
  const auto number = [&](int k) { return sum_of(fine, all_coarse + i, k); };
  SplatGradientSum sum = load_in_vectors(gradients + i);
  sum.mean2d += Vec2f(number(0), number(1));
  sum.conic_xx += number(2), sum.conic_xy += number(3), sum.conic_yy += number(4);
  sum.opacity += number(5);
  sum.red += number(6), sum.green += number(7), sum.blue += number(8);
  sum.absolute_x += number(9), sum.absolute_y += number(10);
  store_in_vectors(gradients + i, sum);
  store_in_vectors(all_fine + i, FineSums{});
  if (fine.has_coarse) all_coarse[i] = {};
}

}  // namespace

void blend_backward(Context& context, const RenderSettings& settings, Span<const float> dL_dimage,
                    Workspace& workspace, RenderPass& pass) {
  const StageScope scope(context, "blend backward");
  GS_CHECK(dL_dimage.size == 3 * pass.pixel_count());
  const CudaScratch& scratch = pass.scratch<CudaScratch>();
  const Forward forward{pass.image.data(), pass.transmittance.data(), pass.last_instance.data(),
                        scratch.first_checkpoints.data(), scratch.checkpoints()};
  const auto launch = [&](auto rule, const auto& sums) {
    context.launch("blend backward",
                   blend_backward_kernel<rule(), std::remove_cvref_t<decltype(sums)>>,
                   blend_blocks(scratch.segments.size()), kBlendThreads, tile_lists(pass),
                   scratch.segments.data(), settings.background, forward, dL_dimage.data, sums);
  };
  const auto launch_by_rule = [&](const auto& sums) {
    if (settings.blend_rule == BlendRule::classic)
      launch(std::integral_constant<BlendRule, BlendRule::classic>(), sums);
    else
      launch(std::integral_constant<BlendRule, BlendRule::faster_gs>(), sums);
  };
  const FragmentSink fragments{
      settings.deterministic ? nullptr : workspace.fragment_sums.data(),
      settings.deterministic ? workspace.fixed_fragment_sums.data() : nullptr,
      settings.fragment_statistic == FragmentStatistic::values ? workspace.pixel_values.data()
                                                               : nullptr};
  const auto launch_with = [&](const auto& sums) {
    using Sums = std::remove_cvref_t<decltype(sums)>;
    switch (settings.fragment_statistic) {
      case FragmentStatistic::none: return launch_by_rule(sums);
      case FragmentStatistic::force:
        if constexpr (std::is_same_v<Sums, FloatSums<false>>)
          return launch_by_rule(FloatSumsOfForces{{sums.of_gaussian}});
        else
          return launch_by_rule(WithFragments<Sums, FragmentStatistic::force>{sums, fragments});
      case FragmentStatistic::values:
        return launch_by_rule(WithFragments<Sums, FragmentStatistic::values>{sums, fragments});
    }
  };
  const auto launch_as_asked = [&](auto absolute) {
    if (!settings.deterministic)
      return launch_with(FloatSums<absolute()>{workspace.splat_gradients.data()});
    launch_with(FixedSums<absolute()>{workspace.fine_sums.data(), workspace.coarse_sums.data()});
    const std::size_t count = pass.tile_counts.size();
    context.launch("collect sums", collect_sums_kernel, blocks_for(count, kBlendThreads),
                   kBlendThreads, count, pass.tile_counts.data(), workspace.fine_sums.data(),
                   workspace.coarse_sums.data(), workspace.splat_gradients.data());
  };
  if (settings.absolute_gradient)
    launch_as_asked(std::true_type());
  else
    launch_as_asked(std::false_type());
}

}  // namespace gs::cuda
