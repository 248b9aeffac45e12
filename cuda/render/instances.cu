// SPDX-License-Identifier: Apache-2.0
// Stage 2: write one instance for each tile that a visible Gaussian hits, in depth order. A warp
// fills kPlacesPerWarp consecutive places of the list. They may belong to many small splats or to a
// part of one that covers the picture, so that the work is balanced.
#include "cuda/render/instance_buffer.cuh"
#include "cuda/render/reports.cuh"
#include "cuda/render/row_spans.cuh"
#include "cuda/stages.cuh"
#include "gs_core/error.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 128;
constexpr std::uint32_t kPlacesPerWarp = 128;  // few enough that short lists also occupy the GPU

template <class AnySplat, int edge_>
struct Input {
  static constexpr int edge = edge_;    // of a tile
  std::uint32_t count;                  // of Gaussians in depth order
  const std::uint32_t* depth_order;     // (count)
  const std::uint32_t* first_of_order;  // (count)
  const std::uint32_t* tile_counts;     // (N) by Gaussian, like the arrays that follow
  const Rect* pixel_rects;
  const AnySplat* splats;
  TileBounds bounds;
  int tiles_x;
  std::uint32_t tiles;

  __device__ std::uint32_t instances() const {
    if (count == 0) return 0;
    return saturating_sum(first_of_order[count - 1], tile_counts[depth_order[count - 1]]);
  }
};

template <class Key>
struct Output {
  Key* keys;
  std::uint32_t* splats;
  InstanceLimit limit;
};

// Shared memory of one warp: the tile rows of 32 splats, and the spans of 32 rows.
template <int edge>
struct WarpShared {
  TileRows<edge> rows;
  std::uint32_t gaussian_of_splat[kWarp];
  std::uint32_t first[kWarp];  // number of the span's first instance among those of the 32
  std::uint32_t gaussian[kWarp], tile[kWarp];  // the span's Gaussian, and its first tile
  int tile_x[kWarp];                           // that tile's column
  PartSpans<edge> parts[kWarp];
};

// The whole warp: finds the last Gaussian in depth order whose instances begin at `place` or
// before, by a search that probes 32 candidates in each round.
template <class In>
__device__ std::uint32_t order_of_place(const In& in, std::uint32_t place) {
  std::uint32_t begin = 0, count = in.count;
  while (count > 1) {
    const std::uint32_t step = (count + kWarp - 1) / kWarp;
    const std::uint32_t at = lane_of_thread() * step;
    const bool is_before = at < count && in.first_of_order[begin + at] <= place;
    const std::uint32_t passed = __popc(__ballot_sync(kAllLanes, is_before));
    const std::uint32_t skipped = (passed - 1) * step;  // passed > 0
    begin += skipped;
    count = min(step, count - skipped);
  }
  return begin;
}

// The whole warp: writes the instances of rows row .. row + 31, which begin at `place`, as far as
// they lie in [begin, end). Returns where the instances of the next rows begin.
template <class Key, class In>
__device__ std::uint32_t write_spans(WarpShared<In::edge>& shared, const In& in,
                                     const Output<Key>& out, std::uint32_t row, std::uint32_t rows,
                                     std::uint32_t place, std::uint32_t begin, std::uint32_t end) {
  const int lane = lane_of_thread();
  std::uint32_t length = 0;
  if (row + lane < rows) {
    const int owner = owner_of(row + lane, shared.rows.first);
    const TileSpan span = shared.rows.span(row + lane, owner);
    length = max(span.end - span.begin, 0);
    shared.gaussian[lane] = shared.gaussian_of_splat[owner];
    shared.tile[lane] = shared.rows.tile_y(row + lane, owner) * in.tiles_x + span.begin;
    shared.tile_x[lane] = span.begin;
    shared.parts[lane] = shared.rows.parts(row + lane, owner);
  }
  const std::uint32_t first = warp_exclusive_sum(length);
  shared.first[lane] = first;
  const std::uint32_t total = __shfl_sync(kAllLanes, first + length, kWarp - 1);
  __syncwarp();
  const std::uint32_t last = min(total, end - min(place, end));
  for (std::uint32_t k = (begin > place ? begin - place : 0) + lane; k < last; k += kWarp) {
    const int owner = owner_of(k, shared.first);
    const std::uint32_t number = k - shared.first[owner];
    out.keys[place + k] = Key(shared.tile[owner] + number);
    out.splats[place + k] = instance_of<In::edge>(
        shared.gaussian[owner], shared.parts[owner].parts_of(shared.tile_x[owner] + int(number)));
  }
  __syncwarp();
  return place + total;
}

// The whole warp: writes the instances of places [begin, end).
template <class Key, class In>
__device__ void write_places(WarpShared<In::edge>& shared, const In& in, const Output<Key>& out,
                             std::uint32_t begin, std::uint32_t end) {
  const int lane = lane_of_thread();
  std::uint32_t order = order_of_place(in, begin);
  for (std::uint32_t place = in.first_of_order[order]; place < end; order += kWarp) {
    SplatOutline splat;
    Rect pixels{0, 0, 0, 0};
    if (order + lane < in.count && in.first_of_order[order + lane] < end) {
      const std::uint32_t gaussian = in.depth_order[order + lane];
      if (in.tile_counts[gaussian]) {
        splat = outline_of(load_in_vectors(in.splats + gaussian));
        pixels = in.pixel_rects[gaussian];
        shared.gaussian_of_splat[lane] = gaussian;
      }
    }
    const std::uint32_t rows = shared.rows.take(splat, pixels, in.bounds);
    for (std::uint32_t row = 0; row < rows && place < end; row += kWarp)
      place = write_spans(shared, in, out, row, rows, place, begin, end);
    if (rows == 0) return;  // happens only if counts and spans disagree
    __syncwarp();
  }
}

template <class Key, class In>
__global__ void __launch_bounds__(kThreads) create_instances_kernel(In in, Output<Key> out) {
  __shared__ WarpShared<In::edge> shared_of_warps[kThreads / kWarp];
  const std::uint32_t warp = (blockIdx.x * kThreads + threadIdx.x) / kWarp;
  const InstanceLimit& limit = out.limit;
  const std::uint32_t begin = min(warp * kPlacesPerWarp, limit.capacity);
  const std::uint32_t end = min(begin + kPlacesPerWarp, limit.capacity), total = in.instances();
  if (blockIdx.x == 0 && threadIdx.x == 0) {
    const bool are_too_many = total > limit.capacity;
    if (limit.halted && are_too_many) *limit.halted = 1;
    if (limit.report)
      write_report(limit.report, total, limit.halted ? *limit.halted : are_too_many, limit.step);
  }
  if (begin < min(end, total))
    write_places(shared_of_warps[threadIdx.x / kWarp], in, out, begin, min(end, total));
  // The places behind the last instance belong to no tile.
  for (std::uint32_t place = max(begin, total) + lane_of_thread(); place < end; place += kWarp) {
    out.keys[place] = Key(in.tiles);
    out.splats[place] = 0;
  }
}

constexpr int kMaskThreads = 256;

// One block for each tile: whether it has a pixel of the mask above 0.
__global__ void __launch_bounds__(kMaskThreads)
    drawn_tiles_kernel(const std::uint8_t* mask, int width, int height, int tiles_x, int edge,
                       std::uint8_t* is_drawn) {
  const int left = int(blockIdx.x) % tiles_x * edge, top = int(blockIdx.x) / tiles_x * edge;
  bool has_pixel = false;
  for (int i = threadIdx.x; i < edge * edge; i += kMaskThreads) {
    const int x = left + i % edge, y = top + i / edge;
    has_pixel |= x < width && y < height && mask[std::size_t(y) * width + x] > 0;
  }
  has_pixel = __syncthreads_or(has_pixel);
  if (threadIdx.x == 0) is_drawn[blockIdx.x] = has_pixel;
}

// The instances of the other tiles belong to no tile.
template <class Key>
__global__ void __launch_bounds__(kThreads)
    leave_out_kernel(Key* keys, std::uint32_t capacity, std::uint32_t tiles,
                     const std::uint8_t* is_drawn) {
  const std::uint32_t i = blockIdx.x * kThreads + threadIdx.x;
  if (i < capacity && keys[i] < tiles && !is_drawn[keys[i]]) keys[i] = Key(tiles);
}

__global__ void report_instances_kernel(Input<Splat, kTileWidth> in, StepReport* report,
                                        std::uint32_t step) {
  write_report(report, in.instances(), 0, step);
}

template <int edge, class AnySplat>
Input<AnySplat, edge> input_of(const RenderSettings& settings, const Workspace& workspace,
                               const RenderPass& pass, const AnySplat* splats) {
  return {std::uint32_t(pass.depth_order.size()),
          pass.depth_order.data(),
          workspace.first_of_order.data(),
          pass.tile_counts.data(),
          pass.pixel_rects.data(),
          splats,
          settings.bounds,
          pass.tiles_x,
          std::uint32_t(pass.tile_count())};
}

}  // namespace

void check_gaussian_count(const RenderPass& pass) {
  if (pass.tile_counts.size() > kMostGaussians)
    throw Error(
        "a GPU renders at most 268 million Gaussians; prune the model or set "
        "density.max_gaussians");
}

void report_instances(Context& context, const RenderSettings& settings, Workspace& workspace,
                      const RenderPass& pass, StepReport* report, std::uint32_t step) {
  context.launch("count of instances", report_instances_kernel, 1, 1,
                 input_of<kTileWidth>(settings, workspace, pass, pass.splats.data()), report, step);
}

void create_instances(Context& context, const RenderSettings& settings, Workspace& workspace,
                      RenderPass& pass, const InstanceLimit& limit) {
  const StageScope scope(context, "instances");
  check_gaussian_count(pass);
  Buffer<Vec4f>& buffer = instance_buffer(settings, workspace, pass);
  reserve_instances(settings, buffer, pass, limit.capacity);
  if (settings.mask) {
    workspace.drawn_tiles.resize_discard(pass.tile_count());
    context.launch("masked tiles", drawn_tiles_kernel, pass.tile_count(), kMaskThreads,
                   settings.mask, pass.width, pass.height, pass.tiles_x, pass.tile_edge,
                   workspace.drawn_tiles.data());
  }
  with_tiles(pass, [&](auto edge, const auto* splats) {
    const auto in = input_of<edge()>(settings, workspace, pass, splats);
    const auto launch = [&](auto key) {
      using Key = decltype(key);
      const UnsortedInstances<Key> to = unsorted_instances<Key>(buffer, pass, limit.capacity);
      const Output<Key> out{to.keys, to.splats, limit};
      context.launch("instances", create_instances_kernel<Key, std::remove_const_t<decltype(in)>>,
                     blocks_for(limit.capacity, kPlacesPerWarp * (kThreads / kWarp)), kThreads, in,
                     out);
      if (settings.mask)
        context.launch("masked tiles", leave_out_kernel<Key>, blocks_for(limit.capacity, kThreads),
                       kThreads, to.keys, limit.capacity, in.tiles, workspace.drawn_tiles.data());
    };
    if (uses_short_keys(pass))
      launch(std::uint16_t());
    else
      launch(std::uint32_t());
  });
}

}  // namespace gs::cuda
