// SPDX-License-Identifier: Apache-2.0
// One buffer for three things that never live together: scratch of the depth sort, then the
// instances until they are sorted by tile, and then the checkpoints of blending, which the backward
// pass reads. A pass with segments owns its buffer, because its checkpoints outlive other renders.
// All other passes share one in the Workspace.
#pragma once

#include <algorithm>
#include <bit>
#include <utility>

#include "cuda/render/radix_sort.cuh"
#include "cuda/stages.cuh"

namespace gs::cuda {

inline Buffer<Vec4f>& instance_buffer(const RenderSettings& settings, Workspace& workspace,
                                      RenderPass& pass) {
  return settings.for_backward ? pass.scratch<CudaScratch>().instance_buffer
                               : workspace.instance_buffer;
}

/// Checkpoints of lists with at most so many instances, in pixels.
inline std::size_t checkpoint_pixels(std::uint32_t capacity) {
  return std::size_t(capacity / kSegmentLength) * kTileWidth * kTileHeight;
}

/// An upper bound of the number of segments of lists with so many instances.
inline std::size_t most_segments(std::size_t tiles, std::uint32_t instances) {
  return tiles + instances / kSegmentLength;
}

/// The bits of a depth in the keys of the tile sort: none but in the order by pixel.
inline int depth_bits(const RenderPass& pass) {
  const int left = 32 - int(std::bit_width(pass.tile_count()));
  return is_by_pixel(pass) ? std::min(left, kDepthKeyBits) : 0;
}
/// The bits of the keys: those of a tile's number, or of the number that means "no tile", and of a
/// depth.
inline int tile_key_bits(const RenderPass& pass) {
  return int(std::bit_width(pass.tile_count())) + depth_bits(pass);
}

/// The arrays of the tile sort. create_instances() fills `keys` and `splats`, the sort uses
/// `other_keys` and `other_splats` as well. Either `splats` or `other_splats` is pass.tile_splats:
/// the one that most likely receives the result. The others lie in the buffer.
template <class Key>
struct UnsortedInstances {
  Key *keys, *other_keys;                // (capacity) tiles
  std::uint32_t *splats, *other_splats;  // (capacity) Gaussians, in depth order at first
};

/// Where they lie. With keys of 16 bits they take as many bytes as the checkpoints.
template <class Key>
UnsortedInstances<Key> unsorted_instances(const Buffer<Vec4f>& buffer, const RenderPass& pass,
                                          std::uint32_t capacity) {
  constexpr std::size_t kInOne = sizeof(Vec4f) / sizeof(std::uint32_t);
  constexpr std::size_t kKeysInOne = sizeof(Vec4f) / sizeof(Key);
  auto* const splats = reinterpret_cast<std::uint32_t*>(buffer.data());
  Vec4f* const keys = buffer.data() + (capacity + kInOne - 1) / kInOne;
  Vec4f* const other_keys = keys + (capacity + kKeysInOne - 1) / kKeysInOne;
  UnsortedInstances<Key> instances{reinterpret_cast<Key*>(keys), reinterpret_cast<Key*>(other_keys),
                                   splats, pass.tile_splats.data()};
  if (sort_returns(tile_key_bits(pass))) std::swap(instances.splats, instances.other_splats);
  return instances;
}

/// Makes the buffer large enough for the instances, and for the checkpoints that follow. What it
/// holds is lost.
inline void reserve_instances(const RenderSettings& settings, Buffer<Vec4f>& buffer,
                              RenderPass& pass, std::uint32_t capacity) {
  const std::size_t bytes = unsorted_bytes(uses_short_keys(pass));
  const std::size_t instances = (capacity * bytes) / sizeof(Vec4f) + 3;  // three arrays, rounded up
  const std::size_t size =
      std::max(instances, settings.for_backward ? checkpoint_pixels(capacity) : 0);
  if (buffer.size() < size) buffer.resize_discard(size);
  if (settings.for_backward && settings.blends_depth)
    pass.scratch<CudaScratch>().depth_checkpoints.resize_discard(checkpoint_pixels(capacity));
  pass.tile_splats.resize_discard(capacity);
}

}  // namespace gs::cuda
