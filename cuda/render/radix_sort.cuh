// SPDX-License-Identifier: Apache-2.0
// CUB's stable radix sort of key-value pairs, with blocks that suit the lists of a view. These
// mostly have less than a million pairs. CUB gives a block some nine thousand, so that most of a
// large GPU would be idle (docs/lab/2026-11-gpu-stages.md).
#pragma once

#include <cub/device/device_radix_sort.cuh>

#include "cuda/device/cub_scratch.cuh"

namespace gs::cuda {

/// Pairs from which on a list is sorted in blocks of CUB's own size.
inline constexpr std::uint32_t kLongList = 1500000;

// The size of CUB's blocks can be chosen from outside in CUB 3.0 to 3.2 (CUDA 13.0 to 13.2). Other
// versions take their own size for lists of every length: the result is the same, and short lists
// take longer.
#if CUB_VERSION >= 300000 && CUB_VERSION < 300300 && !defined(GS_FORCE_PORTABLE_CUB)
#define GS_CUB_TAKES_BLOCK_SIZE
#endif

#ifdef GS_CUB_TAKES_BLOCK_SIZE
/// CUB's policies, except for the size of the blocks that sort by one digit.
template <class Key>
struct ShortBlocks {
  using Standard =
      typename cub::detail::radix::policy_hub<Key, std::uint32_t, std::uint32_t>::Policy900;
  struct MaxPolicy : cub::ChainedPolicy<500, MaxPolicy, MaxPolicy> {
    static constexpr bool ONESWEEP = true;
    static constexpr int ONESWEEP_RADIX_BITS = Standard::ONESWEEP_RADIX_BITS;
    static constexpr int kThreads = 256, kItems = 10;
    using HistogramPolicy = typename Standard::HistogramPolicy;
    using ExclusiveSumPolicy = typename Standard::ExclusiveSumPolicy;
    using OnesweepPolicy = cub::AgentRadixSortOnesweepPolicy<
        kThreads, kItems, std::uint32_t, 1, cub::RADIX_RANK_MATCH_EARLY_COUNTS_ANY,
        cub::BLOCK_SCAN_RAKING_MEMOIZE, cub::RADIX_SORT_STORE_DIRECT, ONESWEEP_RADIX_BITS>;
    using ScanPolicy = typename Standard::ScanPolicy;
    using DownsweepPolicy = typename Standard::DownsweepPolicy;
    using AltDownsweepPolicy = typename Standard::AltDownsweepPolicy;
    using UpsweepPolicy = typename Standard::UpsweepPolicy;
    using AltUpsweepPolicy = typename Standard::AltUpsweepPolicy;
    using SingleTilePolicy = typename Standard::SingleTilePolicy;
    using SegmentedPolicy = typename Standard::SegmentedPolicy;
    using AltSegmentedPolicy = typename Standard::AltSegmentedPolicy;
  };
};
#endif

#ifdef GS_CUB_TAKES_BLOCK_SIZE
/// The sort in such blocks; `may_overwrite`: of what it reads.
template <class Key>
cudaError_t sort_in_short_blocks(Context& context, void* temporary, std::size_t& bytes,
                                 cub::DoubleBuffer<Key>& keys,
                                 cub::DoubleBuffer<std::uint32_t>& values, std::uint32_t count,
                                 int bits, bool may_overwrite) {
  using Sort = cub::DispatchRadixSort<cub::SortOrder::Ascending, Key, std::uint32_t, std::uint32_t,
                                      cub::detail::identity_decomposer_t, ShortBlocks<Key>>;
  return Sort::Dispatch(temporary, bytes, keys, values, count, 0, bits, may_overwrite,
                        context.stream());
}
#endif

/// Sorts `count` pairs by the lowest `bits` bits of their keys, from two arrays into two others.
/// The scratch has some sizeof(Key) + 4 bytes for each of them.
template <class Key, class T>
void sort_pairs(Context& context, Buffer<T>& scratch, const char* what, const Key* keys,
                Key* sorted_keys, const std::uint32_t* values, std::uint32_t* sorted_values,
                std::uint32_t count, int bits) {
  with_cub_scratch(scratch, what, [&](void* temporary, std::size_t& bytes) {
#ifdef GS_CUB_TAKES_BLOCK_SIZE
    if (count < kLongList) {
      cub::DoubleBuffer<Key> both_keys(const_cast<Key*>(keys), sorted_keys);
      cub::DoubleBuffer<std::uint32_t> both_values(const_cast<std::uint32_t*>(values),
                                                   sorted_values);
      return sort_in_short_blocks(context, temporary, bytes, both_keys, both_values, count, bits,
                                  false);
    }
#endif
    return cub::DeviceRadixSort::SortPairs(temporary, bytes, keys, sorted_keys, values,
                                           sorted_values, int(count), 0, bits, context.stream());
  });
}

/// Sorts between two arrays of keys and two of values, both of which it overwrites. The result
/// is in Current() of either. The scratch is small: a 256th of the pairs, or less.
template <class Key, class T>
void sort_pairs(Context& context, Buffer<T>& scratch, const char* what,
                cub::DoubleBuffer<Key>& keys, cub::DoubleBuffer<std::uint32_t>& values,
                std::uint32_t count, int bits) {
  with_cub_scratch(scratch, what, [&](void* temporary, std::size_t& bytes) {
#ifdef GS_CUB_TAKES_BLOCK_SIZE
    if (count < kLongList)
      return sort_in_short_blocks(context, temporary, bytes, keys, values, count, bits, true);
#endif
    return cub::DeviceRadixSort::SortPairs(temporary, bytes, keys, values, int(count), 0, bits,
                                           context.stream());
  });
}

/// True where such a sort most likely leaves its result where the pairs were: after an even number
/// of passes by digits of 8 bits.
inline bool sort_returns(int bits) { return (bits + 7) / 8 % 2 == 0; }

}  // namespace gs::cuda
