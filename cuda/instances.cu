// SPDX-License-Identifier: Apache-2.0
// Stage 2: one instance for each tile that a visible Gaussian hits, in depth order. A warp writes the instances of
// 32 Gaussians together, so that its stores are next to each other however unequal the Gaussians are.
#include "cuda/stages.cuh"
#include "cuda/tile_mask.cuh"

namespace gs::cuda {
namespace {

constexpr int kThreads = 128;

struct Input {
  std::uint32_t count;                 // of Gaussians
  const std::uint32_t* depth_order;    // (N)
  const std::uint32_t* first_of_order; // (N)
  const std::uint32_t* tile_counts;    // (N) by Gaussian, as all that follow
  const std::uint64_t* tile_masks;
  const Rect* pixel_rects;
  const Splat* splats;
  int tiles_x;
  std::uint32_t tiles;
};

template <class Key>
struct Output {
  Key* keys;
  std::uint32_t* splats;
  std::uint32_t capacity;
  std::uint32_t* halted;
  volatile StepReport* report;
  std::uint32_t step;

  __device__ void write(std::uint32_t place, std::uint32_t tile, std::uint32_t gaussian) const {
    if (place >= capacity) return;
    keys[place] = Key(tile);
    splats[place] = gaussian;
  }
};

// The Gaussians of a warp whose hits are a mask.
struct WarpRoom {
  std::uint32_t begin[kWarp];           // number of the Gaussian's first instance among those of the warp
  std::uint32_t first[kWarp], gaussian[kWarp];
  Rect tiles[kWarp];
  std::uint64_t mask[kWarp];
};

// The whole warp: the instances of all lanes whose hits are a mask.
template <class Key>
__device__ void write_masked(WarpRoom& room, const Input& in, const Output<Key>& out,
                             std::uint32_t total) {
  for (std::uint32_t k = lane_of_thread(); k < total; k += kWarp) {
    const int owner = owner_of(k, room.begin);
    const std::uint32_t n = k - room.begin[owner];
    const TilePosition tile = nth_tile(room.tiles[owner], nth_set_bit(room.mask[owner], n));
    out.write(room.first[owner] + n, tile.y * in.tiles_x + tile.x, room.gaussian[owner]);
  }
}

// The whole warp: the instances of one Gaussian with many candidates, tested as the count tested them.
template <class Key>
__device__ void write_tested(const Input& in, const Output<Key>& out, std::uint32_t gaussian,
                             std::uint32_t first) {
  const Splat splat = in.splats[gaussian];
  const Rect tiles = tile_rect(in.pixel_rects[gaussian]);
  const std::uint32_t area = tile_area(tiles);
  for (std::uint32_t base = 0; base < area; base += kWarp) {
    const std::uint32_t k = base + lane_of_thread();
    const TilePosition tile = nth_tile(tiles, k);
    const bool hit =
        k < area && tile_is_hit(splat.mean2d, splat.conic, splat.cutoff, tile.x, tile.y);
    const unsigned hits = __ballot_sync(kAllLanes, hit);
    if (hit)
      out.write(first + __popc(hits & lanes_below()), tile.y * in.tiles_x + tile.x, gaussian);
    first += __popc(hits);
  }
}

// Gives the places behind the last instance to no tile; one thread tells how many instances there are.
template <class Key>
__device__ void finish(const Input& in, const Output<Key>& out, std::uint32_t thread) {
  std::uint32_t total = 0;
  if (in.count)
    total = in.first_of_order[in.count - 1] + in.tile_counts[in.depth_order[in.count - 1]];
  for (std::uint32_t place = total + thread; place < out.capacity; place += gridDim.x * kThreads)
    out.write(place, in.tiles, 0);
  if (thread > 0) return;
  if (total > out.capacity) *out.halted = 1;
  if (!out.report) return;
  out.report->instances = total;
  out.report->halted = *out.halted;
  __threadfence_system();
  out.report->step = out.step;
}

template <class Key>
__global__ void __launch_bounds__(kThreads) create_instances_kernel(Input in, Output<Key> out) {
  __shared__ WarpRoom rooms[kThreads / kWarp];
  WarpRoom& room = rooms[threadIdx.x / kWarp];
  const std::uint32_t thread = blockIdx.x * kThreads + threadIdx.x;
  finish(in, out, thread);

  const int lane = lane_of_thread();
  std::uint32_t gaussian = 0, hits = 0, first = 0;
  if (thread < in.count) {
    gaussian = in.depth_order[thread];
    hits = in.tile_counts[gaussian];
    first = in.first_of_order[thread];
  }
  if (!__any_sync(kAllLanes, hits > 0)) return;
  Rect tiles{0, 0, 0, 0};
  if (hits) tiles = tile_rect(in.pixel_rects[gaussian]);
  const bool is_masked = hits && tile_area(tiles) <= kTileMaskBits;
  const std::uint32_t masked_hits = is_masked ? hits : 0;
  const std::uint32_t begin = warp_exclusive_sum(masked_hits);
  room.begin[lane] = begin;
  room.first[lane] = first;
  room.gaussian[lane] = gaussian;
  room.tiles[lane] = tiles;
  room.mask[lane] = is_masked ? in.tile_masks[gaussian] : 0;
  __syncwarp();
  write_masked(room, in, out, __shfl_sync(kAllLanes, begin + masked_hits, kWarp - 1));
  for (unsigned large = __ballot_sync(kAllLanes, hits && !is_masked); large; large &= large - 1) {
    const int owner = __ffs(int(large)) - 1;
    write_tested(in, out, room.gaussian[owner], room.first[owner]);
  }
}

}  // namespace

void create_instances(Context& context, WorkingRoom& room, RenderPass& pass, std::uint32_t capacity,
                      StepReport* report, std::uint32_t step) {
  const StageScope scope(context, "instances");
  const std::size_t count = pass.tile_counts.size();
  room.keys.resize_discard(capacity);
  room.instance_splats.resize_discard(capacity);
  const Input in{std::uint32_t(count),        pass.depth_order.data(), room.first_of_order.data(),
                 pass.tile_counts.data(),     room.tile_masks.data(),  pass.pixel_rects.data(),
                 pass.splats.data(),          pass.tiles_x,            std::uint32_t(pass.tile_count())};
  const auto launch = [&](auto* keys) {
    using Key = std::remove_pointer_t<decltype(keys)>;
    const Output<Key> out{keys, room.instance_splats.data(), capacity, room.halted.data(), report, step};
    context.launch("instances", create_instances_kernel<Key>,
                   std::max<std::size_t>(blocks_for(count, kThreads), 1), kThreads, in, out);
  };
  if (uses_short_keys(pass))
    launch(reinterpret_cast<std::uint16_t*>(room.keys.data()));
  else
    launch(room.keys.data());
}

}  // namespace gs::cuda
