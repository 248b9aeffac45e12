// SPDX-License-Identifier: Apache-2.0
// Stages 2 and 3: the two sorts that make the tile lists. The first sorts the Gaussians by depth,
// the second all instances by tile. The second is stable, so that each tile's list keeps the depth
// order.   Faster-GS, two-stage radix sort
#include <thrust/iterator/counting_iterator.h>
#include <thrust/iterator/transform_iterator.h>

#include <cub/device/device_partition.cuh>
#include <cub/device/device_scan.cuh>

#include "cuda/render/blend/length_classes.cuh"
#include "cuda/render/instance_buffer.cuh"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;

__global__ void number_rows_kernel(std::uint32_t* numbers, std::uint32_t count) {
  const std::uint32_t i = blockIdx.x * kThreads + threadIdx.x;
  if (i < count) numbers[i] = i;
}

struct IsVisible {
  const std::uint32_t* tile_counts;
  __device__ bool operator()(std::uint32_t gaussian) const { return tile_counts[gaussian] > 0; }
};

__global__ void take_keys_kernel(const std::uint32_t* rows, std::uint32_t count,
                                 const std::uint32_t* keys, std::uint32_t* taken) {
  const std::uint32_t k = blockIdx.x * kThreads + threadIdx.x;
  if (k < count) taken[k] = keys[rows[k]];
}

// The tile count of a Gaussian, for an iterator over the depth order.
struct TileCount {
  const std::uint32_t* tile_counts;
  __device__ std::uint32_t operator()(std::uint32_t gaussian) const {
    return tile_counts[gaussian];
  }
};

struct SaturatingSum {
  GS_HD std::uint32_t operator()(std::uint32_t a, std::uint32_t b) const {
    return saturating_sum(a, b);
  }
};

static_assert(2 * kLengthClasses <= kThreads);  // one block of tile_ranges_kernel clears them

// The tiles of keys whose lower bits are a depth's.
struct TilesOfKeys {
  const std::uint32_t* keys;
  int depth_bits;
  __device__ std::uint32_t operator[](std::uint32_t i) const { return keys[i] >> depth_bits; }
};

// Range t begins at the first instance whose tile is not below t.
template <class Keys>
__global__ void tile_ranges_kernel(Keys keys, std::uint32_t capacity, std::uint32_t tiles,
                                   std::uint32_t* ranges, std::uint32_t* length_classes) {
  const std::uint32_t i = blockIdx.x * kThreads + threadIdx.x;
  if (length_classes && i < 2 * kLengthClasses) length_classes[i] = 0;  // for order_tiles()
  if (i >= capacity) return;
  const std::uint32_t key = keys[i];
  for (std::uint32_t tile = i ? keys[i - 1] + 1u : 0u; tile <= key; ++tile) ranges[tile] = i;
  if (i + 1 == capacity)
    for (std::uint32_t tile = key + 1; tile <= tiles; ++tile) ranges[tile] = capacity;
}

constexpr int kOrderThreads = 1024;  // one block

struct BlendOrder {
  std::uint32_t* tiles;              // (tiles)
  std::uint32_t* first_checkpoints;  // (tiles)
  ListSegment* segments;             // (capacity)
  std::uint32_t capacity;
};

// Calls visit(number, length) for each segment of a list; an empty list is one segment.
template <class Visit>
__device__ void for_each_segment(std::uint32_t length, Visit&& visit) {
  std::uint32_t number = 0;
  do {
    const std::uint32_t first = number * kSegmentLength;
    visit(number++, min(length - first, kSegmentLength));
  } while (number * kSegmentLength < length);
}

// Orders all tiles, and all segments of their lists, the longest first, so that blending does not
// end with a few long ones.
__global__ void __launch_bounds__(kOrderThreads)
    blend_order_kernel(const std::uint32_t* ranges, std::uint32_t tiles, BlendOrder order) {
  __shared__ ClassSort by_list, by_segment;
  __shared__ std::uint32_t checkpoints, segments;
  by_list.clear();
  by_segment.clear();
  if (threadIdx.x == 0) checkpoints = 0;
  __syncthreads();
  for (std::uint32_t tile = threadIdx.x; tile < tiles; tile += kOrderThreads) {
    const std::uint32_t length = ranges[tile + 1] - ranges[tile];
    by_list.count(length);
    for_each_segment(length, [&](std::uint32_t, std::uint32_t part) { by_segment.count(part); });
  }
  __syncthreads();
  if (threadIdx.x < kWarp) {
    by_list.sum();
  } else if (threadIdx.x < 2 * kWarp) {
    const std::uint32_t sum = by_segment.sum();
    if (lane_of_thread() == 0) segments = sum;
  }
  __syncthreads();
  for (std::uint32_t tile = threadIdx.x; tile < tiles; tile += kOrderThreads) {
    const std::uint32_t length = ranges[tile + 1] - ranges[tile];
    order.tiles[by_list.place(length)] = tile;
    order.first_checkpoints[tile] =
        length > kSegmentLength ? atomicAdd(&checkpoints, (length - 1) / kSegmentLength) : 0;
    for_each_segment(length, [&](std::uint32_t number, std::uint32_t part) {
      order.segments[by_segment.place(part)] = {tile, number};
    });
  }
  for (std::uint32_t k = segments + threadIdx.x; k < order.capacity; k += kOrderThreads)
    order.segments[k] = {kNoTile, 0};
}

// The two kernels that order tiles by many blocks. First the classes of all tiles are counted.
__global__ void __launch_bounds__(kThreads)
    count_classes_kernel(const std::uint32_t* ranges, std::uint32_t tiles, std::uint32_t* counts) {
  __shared__ ClassSort of_block;
  of_block.clear();
  __syncthreads();
  const std::uint32_t tile = blockIdx.x * kThreads + threadIdx.x;
  if (tile < tiles) of_block.count(ranges[tile + 1] - ranges[tile]);
  __syncthreads();
  if (threadIdx.x < kLengthClasses && of_block.next[threadIdx.x] > 0)
    atomicAdd(&counts[threadIdx.x], of_block.next[threadIdx.x]);
}

// Then each block takes places for its tiles of each class. `taken` counts those of earlier blocks.
__global__ void __launch_bounds__(kThreads)
    order_tiles_kernel(const std::uint32_t* ranges, std::uint32_t tiles,
                       const std::uint32_t* counts, std::uint32_t* taken, std::uint32_t* order) {
  __shared__ ClassSort of_all, of_block;
  of_block.clear();
  if (threadIdx.x < kLengthClasses) of_all.next[threadIdx.x] = counts[threadIdx.x];
  __syncthreads();
  const std::uint32_t tile = blockIdx.x * kThreads + threadIdx.x;
  const std::uint32_t length = tile < tiles ? ranges[tile + 1] - ranges[tile] : 0;
  const std::uint32_t place = tile < tiles ? of_block.place(length) : 0;  // within the block
  if (threadIdx.x < kWarp) of_all.sum();
  __syncthreads();
  if (threadIdx.x < kLengthClasses && of_block.next[threadIdx.x] > 0)
    of_all.next[threadIdx.x] += atomicAdd(&taken[threadIdx.x], of_block.next[threadIdx.x]);
  __syncthreads();
  if (tile < tiles) order[of_all.next[length_class(length)] + place] = tile;
}

// From so many tiles on, pictures are blended in the order of their tiles: each of the GPU's places
// for a warp gets some 40 of them, so that one long list at the end does not matter.
constexpr std::size_t kMostOrderedTiles = 16'000;

bool are_ordered(const RenderSettings& settings, const RenderPass& pass) {
  return settings.for_backward || pass.tile_count() <= kMostOrderedTiles;
}

void order_tiles(Context& context, Workspace& workspace, RenderPass& pass) {
  const std::uint32_t tiles = std::uint32_t(pass.tile_count());
  std::uint32_t* const counts = workspace.length_classes.data();
  CudaScratch& scratch = pass.scratch<CudaScratch>();
  scratch.tile_order.resize_discard(tiles);
  context.launch("lengths of lists", count_classes_kernel, blocks_for(tiles, kThreads), kThreads,
                 pass.tile_ranges.data(), tiles, counts);
  context.launch("blend order", order_tiles_kernel, blocks_for(tiles, kThreads), kThreads,
                 pass.tile_ranges.data(), tiles, counts, counts + kLengthClasses,
                 scratch.tile_order.data());
}

void order_for_blending(Context& context, RenderPass& pass, std::uint32_t capacity) {
  const std::size_t tiles = pass.tile_count(), segments = most_segments(tiles, capacity);
  CudaScratch& scratch = pass.scratch<CudaScratch>();
  scratch.tile_order.resize_discard(tiles);
  scratch.first_checkpoints.resize_discard(tiles);
  scratch.segments.resize_discard(segments);
  const BlendOrder order{scratch.tile_order.data(), scratch.first_checkpoints.data(),
                         scratch.segments.data(), std::uint32_t(segments)};
  context.launch("blend order", blend_order_kernel, 1, kOrderThreads, pass.tile_ranges.data(),
                 std::uint32_t(tiles), order);
}

// Sorts the instances into pass.tile_splats. Returns the sorted keys.
template <class Key>
const Key* sort_instances(Context& context, const Buffer<Vec4f>& buffer, Workspace& workspace,
                          RenderPass& pass, std::uint32_t capacity) {
  const UnsortedInstances<Key> instances = unsorted_instances<Key>(buffer, pass, capacity);
  cub::DoubleBuffer<Key> keys(instances.keys, instances.other_keys);
  cub::DoubleBuffer<std::uint32_t> splats(instances.splats, instances.other_splats);
  sort_pairs(context, workspace.sort_scratch, "the tile sort", keys, splats, capacity,
             tile_key_bits(pass));
  std::uint32_t* const sorted = pass.tile_splats.data();
  if (splats.Current() != sorted)  // short lists, and GPUs on which CUB takes other digits
    pass.tile_splats.memory().copy(sorted, splats.Current(), capacity * sizeof(std::uint32_t));
  return keys.Current();
}

// Gaussians to be sorted by their depths.
struct DepthPairs {
  const std::uint32_t *keys, *rows;  // (count)
  std::uint32_t count;
};

// The first `taken` Gaussians of an order in which the visible ones come before the culled ones.
DepthPairs visible_first(Context& context, Workspace& workspace, const RenderPass& pass,
                         std::uint32_t taken) {
  const std::size_t count = pass.tile_counts.size();
  workspace.rows.resize_discard(count);
  workspace.are_numbered = false;
  workspace.visible_count.resize_discard(1);
  workspace.taken_depth_keys.resize_discard(taken);
  with_cub_scratch(workspace.sort_scratch, "the visible Gaussians",
                   [&](void* temporary, std::size_t& bytes) {
                     return cub::DevicePartition::If(
                         temporary, bytes, thrust::counting_iterator<std::uint32_t>(0),
                         workspace.rows.data(), workspace.visible_count.data(), int(count),
                         IsVisible{pass.tile_counts.data()}, context.stream());
                   });
  context.launch("depth keys of visible rows", take_keys_kernel, blocks_for(taken, kThreads),
                 kThreads, workspace.rows.data(), taken, workspace.depth_keys.data(),
                 workspace.taken_depth_keys.data());
  return {workspace.taken_depth_keys.data(), workspace.rows.data(), taken};
}

// All Gaussians.
DepthPairs all_rows(Context& context, Workspace& workspace, const RenderPass& pass) {
  const std::uint32_t count = std::uint32_t(pass.tile_counts.size());
  if (!workspace.are_numbered || workspace.rows.size() < count) {
    workspace.are_numbered = false;  // if memory runs out
    workspace.rows.resize_discard(count);
    context.launch("row numbers", number_rows_kernel, blocks_for(count, kThreads), kThreads,
                   workspace.rows.data(), count);
    workspace.are_numbered = true;
  }
  return {workspace.depth_keys.data(), workspace.rows.data(), count};
}

}  // namespace

void order_by_depth(Context& context, const RenderSettings& settings, Workspace& workspace,
                    RenderPass& pass, std::size_t most_visible) {
  const StageScope scope(context, "depth sort");
  const std::size_t count = pass.tile_counts.size();
  const bool are_few_visible = most_visible < count / 2;  // so that selecting them pays
  const std::size_t taken = are_few_visible ? most_visible : count;
  pass.depth_order.resize_discard(taken);
  workspace.first_of_order.resize_discard(taken);
  if (count == 0) return;
  const DepthPairs pairs = are_few_visible
                               ? visible_first(context, workspace, pass, std::uint32_t(taken))
                               : all_rows(context, workspace, pass);
  sort_pairs(context, instance_buffer(settings, workspace, pass), "the depth sort", pairs.keys,
             workspace.first_of_order.data(), pairs.rows, pass.depth_order.data(), pairs.count,
             kDepthKeyBits);
  with_cub_scratch(workspace.sort_scratch, "the sum of the tile counts",
                   [&](void* temporary, std::size_t& bytes) {
                     return cub::DeviceScan::ExclusiveScan(
                         temporary, bytes,
                         thrust::make_transform_iterator(pass.depth_order.data(),
                                                         TileCount{pass.tile_counts.data()}),
                         workspace.first_of_order.data(), SaturatingSum(), 0u, int(taken),
                         context.stream());
                   });
}

void sort_by_tile(Context& context, const RenderSettings& settings, Workspace& workspace,
                  RenderPass& pass, std::uint32_t capacity) {
  const StageScope scope(context, "tile sort");
  const Buffer<Vec4f>& buffer = instance_buffer(settings, workspace, pass);
  pass.tile_ranges.resize_discard(pass.tile_count() + 1);
  workspace.length_classes.resize_discard(2 * kLengthClasses);
  const auto run = [&](auto key) {
    using Key = decltype(key);
    const Key* const sorted = sort_instances<Key>(context, buffer, workspace, pass, capacity);
    const auto launch = [&](auto keys) {
      context.launch("tile ranges", tile_ranges_kernel<decltype(keys)>,
                     blocks_for(capacity, kThreads), kThreads, keys, capacity,
                     std::uint32_t(pass.tile_count()), pass.tile_ranges.data(),
                     workspace.length_classes.data());
    };
    if constexpr (sizeof(Key) == sizeof(std::uint32_t))
      if (is_by_pixel(pass)) return launch(TilesOfKeys{sorted, depth_bits(pass)});
    launch(sorted);
  };
  if (uses_short_keys(pass))
    run(std::uint16_t());
  else
    run(std::uint32_t());
  if (settings.for_backward)
    order_for_blending(context, pass, capacity);
  else if (are_ordered(settings, pass))
    order_tiles(context, workspace, pass);
  else
    pass.scratch<CudaScratch>().tile_order.resize_discard(0);
}

}  // namespace gs::cuda
