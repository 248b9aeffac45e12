// SPDX-License-Identifier: Apache-2.0
// Shared by the row operations, stages 9 and 10: the gather of whole rows, and the order of rows by
// keys.
#pragma once

#include "cuda/device/context.cuh"
#include "gs_core/buffer.h"

namespace gs::cuda {

/// The smallest box around some points. An empty box has its low corner above its high corner.
struct Bounds {
  Vec3f low, high;
};

/// Buffers of sort_rows() and morton_order().
struct RowOrderWorkspace {
  Buffer<std::uint64_t> keys, other_keys;         // (N)
  Buffer<std::uint32_t> row_numbers, other_rows;  // (N)
  Buffer<Bounds> bounds;                          // (1)
  Buffer<std::uint8_t> cub;

  explicit RowOrderWorkspace(Memory& memory)
      : keys(memory), other_keys(memory), row_numbers(memory), other_rows(memory), bounds(memory),
        cub(memory) {}
};

/// morton.cu: the numbers of all rows, sorted by the lowest `bits` bits of workspace.keys,
/// ascending; equal keys by row number. Overwrites the keys. The result lies in `workspace` and is
/// valid until the next call.
Span<const std::uint32_t> sort_rows(Context& context, const char* stage,
                                    RowOrderWorkspace& workspace, int bits);

/// 10  morton.cu: the numbers of all rows along the Morton curve of the means, in their bounding
/// cube, equal codes by row number. Rows in space and time are ordered by their bin of time first,
/// with static ones last; both other arrays are empty where rows have no time. The result lies in
/// `workspace` like that of sort_rows().
Span<const std::uint32_t> morton_order(Context& context, RowOrderWorkspace& workspace,
                                       Span<const Vec3f> means, Span<const float> time_means,
                                       Span<const float> log_time_scales);

inline constexpr int kGatherThreads = 256;  // threads of a block, and rows that it gathers

/// Row i of `to` becomes row source[i] of `from`; a row has kWords words. A block takes
/// kGatherThreads rows. Its threads take one word after another, so that neighboring threads read
/// and write neighboring words.
template <int kWords>
__global__ void gather_kernel(const std::uint32_t* from, Span<const std::uint32_t> source,
                              std::uint32_t* to) {
  const std::size_t first = std::size_t(blockIdx.x) * kGatherThreads;
  const std::size_t left = source.size - first;
  const unsigned words = unsigned(min_of(left, std::size_t(kGatherThreads))) * kWords;
  for (unsigned k = threadIdx.x; k < words; k += kGatherThreads)
    to[first * kWords + k] = from[std::size_t(source[first + k / kWords]) * kWords + k % kWords];
}

/// Gathers arrays one by one through a scratch as large as the largest of them.
class RowGather {
 public:
  RowGather(Context& context, Memory& memory) : context_(context), scratch_(memory) {}

  /// Reserves memory to gather up to so many rows of the array, after which gather() cannot fail.
  template <class T>
  void reserve(Buffer<T>& array, std::size_t count) {
    array.reserve(count);
    scratch_.reserve(count * (sizeof(T) / sizeof(std::uint32_t)));
  }
  void release() { scratch_.release(); }
  /// The array becomes `count` >= source.size rows: array[source[i]] for each i, then rows of
  /// zeros.
  template <class T>
  void gather(Buffer<T>& array, Span<const std::uint32_t> source, std::size_t count) {
    constexpr int kWords = sizeof(T) / sizeof(std::uint32_t);
    static_assert(sizeof(T) == kWords * sizeof(std::uint32_t));
    scratch_.resize_discard(source.size * kWords);
    context_.launch("gather", gather_kernel<kWords>, blocks_for(source.size, kGatherThreads),
                    kGatherThreads, reinterpret_cast<const std::uint32_t*>(array.data()), source,
                    scratch_.data());
    array.resize_discard(count);
    if (source.size) array.memory().copy(array.data(), scratch_.data(), source.size * sizeof(T));
    if (count > source.size)
      array.memory().fill_zero(array.data() + source.size, (count - source.size) * sizeof(T));
  }
  template <class T>
  void gather(Buffer<T>& array, Span<const std::uint32_t> source) {
    gather(array, source, source.size);
  }

 private:
  Context& context_;
  Buffer<std::uint32_t> scratch_;
};

}  // namespace gs::cuda
