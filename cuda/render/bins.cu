// SPDX-License-Identifier: Apache-2.0
// Lists by bins, in place of instances and of both sorts: which bins of 32 or 64 pixels each splat
// hits. The hits of each bin are counted, then the lists get their places, then a walk through the
// same hits writes an entry for each. Entries of a bin are in no order; bin_sort.cu sorts them.
// Both walks call hit_bins_of_row(), compiled without contraction of products and sums, so that
// they find the same bins.
#include <cub/block/block_scan.cuh>

#include "cuda/render/bins.cuh"
#include "cuda/render/length_classes.cuh"
#include "cuda/render/reports.cuh"
#include "cuda/render/row_spans.cuh"
#include "gs_core/math/bin_hits.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 128;
constexpr int kOffsetThreads = 1024;  // one block
constexpr std::uint32_t kNoBin = 0xffffffffu;

struct Input {
  std::uint32_t count;  // N
  const std::uint32_t* tile_counts;
  const Rect* pixel_rects;
  const ViewSplat* splats;
  const std::uint32_t* depth_keys;
  TileBounds bounds;
  int bins_x;
};

// Shared memory of one warp: its 32 splats, and the hit bins of 32 rows of bins. The rows of all
// splats are numbered consecutively, and so are the hits of 32 rows, so that lanes share them
// evenly.
struct WarpShared {
  SplatOutline splats[kWarp];
  Rect pixels[kWarp];
  std::uint32_t first_row[kWarp];                    // of a splat
  std::uint32_t first_hit[kWarp], first_bin[kWarp];  // of a row
  int owner[kWarp];                                  // of a row: its splat
};

// The whole warp: takes 32 splats from row `first` on, and returns the number of their rows of
// bins.
template <int side>
__device__ std::uint32_t take_splats(WarpShared& shared, const Input& in, std::uint32_t first) {
  const std::uint32_t lane = lane_of_thread(), i = first + lane;
  std::uint32_t rows = 0;
  if (i < in.count && in.tile_counts[i] > 0) {
    const Rect pixels = in.pixel_rects[i];
    shared.splats[lane] = outline_of(load_in_vectors(in.splats + i));
    shared.pixels[lane] = pixels;
    rows = (pixels.y_end - 1) / side - pixels.y_begin / side + 1;
  }
  const std::uint32_t before = warp_exclusive_sum(rows);
  shared.first_row[lane] = before;
  __syncwarp();
  return __shfl_sync(kAllLanes, before + rows, kWarp - 1);
}

// The whole warp: finds the bins that rows row .. row + 31 hit, and returns the number of hits.
template <int side>
__device__ std::uint32_t take_rows(WarpShared& shared, const Input& in, std::uint32_t row,
                                   std::uint32_t rows) {
  const int lane = lane_of_thread();
  std::uint32_t length = 0;
  if (row + lane < rows) {
    const int owner = owner_of(row + lane, shared.first_row);
    const Rect pixels = shared.pixels[owner];
    const int bin_y = pixels.y_begin / side + int(row + lane - shared.first_row[owner]);
    const BinSpan span = hit_bins_of_row(in.bounds, shared.splats[owner], pixels, bin_y, side);
    length = max(span.end - span.begin, 0);
    shared.first_bin[lane] = std::uint32_t(bin_y * in.bins_x + span.begin);
    shared.owner[lane] = owner;
  }
  const std::uint32_t first = warp_exclusive_sum(length);
  shared.first_hit[lane] = first;
  __syncwarp();
  return __shfl_sync(kAllLanes, first + length, kWarp - 1);
}

// The whole warp: calls visit(bin, splat, same) for each bin that one of the 32 splats from row
// `first` on hits. All lanes call it together; those left over have kNoBin. `same` are the lanes
// that have the same bin.
template <int side, class Visit>
__device__ void for_each_hit(WarpShared& shared, const Input& in, std::uint32_t first,
                             Visit&& visit) {
  const std::uint32_t rows = take_splats<side>(shared, in, first);
  for (std::uint32_t row = 0; row < rows; row += kWarp) {
    const std::uint32_t hits = take_rows<side>(shared, in, row, rows);
    for (std::uint32_t base = 0; base < hits; base += kWarp) {
      const std::uint32_t hit = base + lane_of_thread();
      std::uint32_t bin = kNoBin;
      int splat = 0;
      if (hit < hits) {
        const int at = owner_of(hit, shared.first_hit);
        bin = shared.first_bin[at] + (hit - shared.first_hit[at]);
        splat = shared.owner[at];
      }
      visit(bin, splat, __match_any_sync(kAllLanes, bin));
    }
    __syncwarp();
  }
}

__device__ int first_lane(unsigned lanes) { return __ffs(int(lanes)) - 1; }

template <int side>
__global__ void __launch_bounds__(kThreads) count_entries_kernel(Input in, std::uint32_t* counts) {
  __shared__ WarpShared shared_of_warps[kThreads / kWarp];
  const std::uint32_t first = (blockIdx.x * kThreads + threadIdx.x) / kWarp * kWarp;
  for_each_hit<side>(shared_of_warps[threadIdx.x / kWarp], in, first,
                     [&](std::uint32_t bin, int, unsigned same) {
                       if (bin != kNoBin && lane_of_thread() == first_lane(same))
                         atomicAdd(&counts[bin], std::uint32_t(__popc(same)));
                     });
}

// The places of all lists.
struct Offsets {
  std::uint32_t *ranges, *first_groups, *order;
};

// One block: turns counts of bins into the places of their lists, and sets them back to zero. With
// more entries than capacity all lists are empty.
__global__ void __launch_bounds__(kOffsetThreads)
    bin_offsets_kernel(std::uint32_t* counts, std::uint32_t bins, Offsets out,
                       InstanceLimit limit) {
  // Entries in the lower half, groups in the upper one.
  using Scan = cub::BlockScan<unsigned long long, kOffsetThreads, cub::BLOCK_SCAN_WARP_SCANS>;
  __shared__ typename Scan::TempStorage scan;
  __shared__ ClassSort classes;
  __shared__ unsigned long long total;
  classes.clear();
  if (threadIdx.x == 0) total = 0;
  __syncthreads();
  unsigned long long own = 0;
  for (std::uint32_t bin = threadIdx.x; bin < bins; bin += kOffsetThreads) {
    own += counts[bin];
    classes.count(counts[bin]);
  }
  own = warp_sum(own);
  if (lane_of_thread() == 0) atomicAdd(&total, own);
  __syncthreads();
  if (threadIdx.x < kWarp) classes.sum();
  const bool are_too_many = total > limit.capacity;
  if (threadIdx.x == 0 && limit.report)
    write_report(limit.report, std::uint32_t(min(total, 0xffffffffull)), are_too_many, limit.step);
  __syncthreads();
  unsigned long long before = 0;
  for (std::uint32_t base = 0; base < bins; base += kOffsetThreads) {
    const std::uint32_t bin = base + threadIdx.x;
    const std::uint32_t counted = bin < bins ? counts[bin] : 0;
    const std::uint32_t listed = are_too_many ? 0 : counted;
    unsigned long long first, sum;
    Scan(scan).ExclusiveSum(listed | (unsigned long long)(groups_of(listed)) << 32, first, sum);
    __syncthreads();
    if (bin < bins) {
      out.ranges[bin] = std::uint32_t(before + first);
      out.first_groups[bin] = std::uint32_t((before + first) >> 32);
      out.order[classes.place(counted)] = bin;
      counts[bin] = 0;
    }
    before += sum;
  }
  if (threadIdx.x > 0) return;
  out.ranges[bins] = std::uint32_t(before);
  out.first_groups[bins] = std::uint32_t(before >> 32);
}

// Writes the entries. `taken` counts those of each bin that have a place.
template <int side>
__global__ void __launch_bounds__(kThreads)
    fill_bins_kernel(Input in, const std::uint32_t* ranges, std::uint32_t* taken,
                     BinEntry* entries) {
  __shared__ WarpShared shared_of_warps[kThreads / kWarp];
  const std::uint32_t first = (blockIdx.x * kThreads + threadIdx.x) / kWarp * kWarp;
  for_each_hit<side>(shared_of_warps[threadIdx.x / kWarp], in, first,
                     [&](std::uint32_t bin, int splat, unsigned same) {
                       const int leader = first_lane(same);
                       std::uint32_t before = 0;
                       if (bin != kNoBin && lane_of_thread() == leader)
                         before = atomicAdd(&taken[bin], std::uint32_t(__popc(same)));
                       before = __shfl_sync(kAllLanes, before, leader);
                       if (bin == kNoBin) return;
                       const std::uint32_t row = first + splat,
                                           at = ranges[bin] + before + __popc(same & lanes_below());
                       if (at < ranges[bin + 1]) entries[at] = bin_entry(in.depth_keys[row], row);
                     });
}

Input input_of(const RenderSettings& settings, const Workspace& workspace, const RenderPass& pass) {
  const CudaScratch& scratch = pass.scratch<CudaScratch>();
  return {std::uint32_t(pass.tile_counts.size()),
          pass.tile_counts.data(),
          pass.pixel_rects.data(),
          scratch.view_splats.data(),
          workspace.depth_keys.data(),
          settings.bounds,
          scratch.bins.bins_x};
}

void size_bins(int side, Workspace& workspace, const RenderPass& pass, BinBuffers& bins) {
  bins.side = side;
  bins.bins_x = (pass.width + side - 1) / side;
  bins.bins_y = (pass.height + side - 1) / side;
  bins.ranges.resize_discard(bins.count() + 1);
  bins.first_groups.resize_discard(bins.count() + 1);
  bins.order.resize_discard(bins.count());
  workspace.bin_counts.resize_discard(bins.count());
  workspace.bin_counts.fill_zero();
}

}  // namespace

void count_bins(Context& context, const RenderSettings& settings, Workspace& workspace,
                RenderPass& pass, const InstanceLimit& limit) {
  const StageScope scope(context, "bins");
  check_gaussian_count(pass);
  BinBuffers& bins = pass.scratch<CudaScratch>().bins;
  size_bins(settings.bin_side, workspace, pass, bins);
  const Input in = input_of(settings, workspace, pass);
  with_bin_side(bins.side, [&](auto side) {
    context.launch("counts of bins", count_entries_kernel<side()>, blocks_for(in.count, kThreads),
                   kThreads, in, workspace.bin_counts.data());
  });
  context.launch("places of bins", bin_offsets_kernel, 1, kOffsetThreads,
                 workspace.bin_counts.data(), std::uint32_t(bins.count()),
                 Offsets{bins.ranges.data(), bins.first_groups.data(), bins.order.data()}, limit);
}

void fill_bins(Context& context, const RenderSettings& settings, Workspace& workspace,
               RenderPass& pass, std::uint32_t capacity) {
  const StageScope scope(context, "entries of bins");
  const BinBuffers& bins = pass.scratch<CudaScratch>().bins;
  workspace.bin_entries.resize_discard(capacity);
  const Input in = input_of(settings, workspace, pass);
  with_bin_side(bins.side, [&](auto side) {
    context.launch("entries of bins", fill_bins_kernel<side()>, blocks_for(in.count, kThreads),
                   kThreads, in, bins.ranges.data(), workspace.bin_counts.data(),
                   workspace.bin_entries.data());
  });
}

}  // namespace gs::cuda
