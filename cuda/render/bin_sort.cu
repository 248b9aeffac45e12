// SPDX-License-Identifier: Apache-2.0
// Sorts the entries of each bin by depth and row, and finds the sub-tiles of 8 x 8 pixels that each
// one hits. A block of threads has a bin.
//
// Up to kMostInShared entries are sorted in shared memory. The range of the bin's depth keys is
// reduced to 16 bits, and two radix passes of 8 bits sort words of such a key and the entry's
// place. Few entries share a key then, and exchanges of neighbors bring those into order. Longer
// lists, and lists whose order the exchanges do not reach soon (for example many entries at one
// depth), are sorted in global memory by a bitonic network.
#include "cuda/render/bins.cuh"
#include "cuda/render/row_spans.cuh"
#include "gs_core/math/bin_hits.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 512, kWarps = kThreads / kWarp;
constexpr int kBlocks = 3;  // per multiprocessor, as many as shared memory allows
constexpr std::uint32_t kMostInShared = 8192;
constexpr int kDigits = 256;
// A word has a reduced depth key above the entry's place.
constexpr int kKeyBits = 16, kPlaceBits = 16;
constexpr int kMostRounds = 32;  // of exchanges
static_assert(kMostInShared <= 1u << kPlaceBits);

struct Input {
  const std::uint32_t *order, *ranges, *first_groups;
  BinEntry* entries;
  const ViewSplat* splats;
  const Rect* pixel_rects;
  TileBounds bounds;
  int bins_x;
  std::uint32_t *rows, *words;
};

struct SortShared {
  std::uint32_t words[2][kMostInShared];
  std::uint16_t places[kWarps][kDigits];  // of a digit's entries: first counts, then the next place
  std::uint32_t first[kDigits];           // place of a digit
  std::uint32_t greatest, greatest_flipped;  // depth key of the bin, and complement of the least
};

// Entries [begin, end) of a warp in a radix pass.
struct Chunk {
  std::uint32_t begin, end;

  __device__ explicit Chunk(std::uint32_t count) {
    const std::uint32_t length = (count + kThreads - 1) / kThreads * kWarp;
    begin = min(threadIdx.x / kWarp * length, count);
    end = min(begin + length, count);
  }
};

// The digit of a lane's entry in a radix pass, and the lanes with the same digit.
struct Digit {
  std::uint32_t word = 0, value = kDigits;
  unsigned same;
  bool is_leader;

  __device__ Digit(const std::uint32_t* from, std::uint32_t at, std::uint32_t end, int bit) {
    if (at < end) {
      word = from[at];
      value = word >> bit & (kDigits - 1);
    }
    same = __match_any_sync(kAllLanes, value);
    is_leader = at < end && (same & lanes_below()) == 0;
  }
};

// The whole block: turns the warps' counts of digits into places.
__device__ void find_places(SortShared& shared) {
  if (threadIdx.x < kDigits) {
    std::uint32_t before = 0;
    for (int warp = 0; warp < kWarps; ++warp) {
      const std::uint32_t count = shared.places[warp][threadIdx.x];
      shared.places[warp][threadIdx.x] = std::uint16_t(before);
      before += count;
    }
    shared.first[threadIdx.x] = before;
  }
  __syncthreads();
  if (threadIdx.x < kWarp) {
    constexpr int kOfLane = kDigits / kWarp;
    std::uint32_t* const own = shared.first + lane_of_thread() * kOfLane;
    std::uint32_t sum = 0;
    for (int k = 0; k < kOfLane; ++k) sum += own[k];
    std::uint32_t before = warp_exclusive_sum(sum);
    for (int k = 0; k < kOfLane; ++k) {
      const std::uint32_t count = own[k];
      own[k] = before;
      before += count;
    }
  }
  __syncthreads();
}

// The whole block: sorts words by eight of their bits, stably.
__device__ void radix_pass(SortShared& shared, const std::uint32_t* from, std::uint32_t* to,
                           std::uint32_t count, int bit) {
  const std::uint32_t lane = lane_of_thread();
  std::uint16_t* const places = shared.places[threadIdx.x / kWarp];
  const Chunk chunk(count);
  for (int digit = lane; digit < kDigits; digit += kWarp) places[digit] = 0;
  __syncwarp();
  for (std::uint32_t k = chunk.begin; k < chunk.end; k += kWarp) {
    const Digit digit(from, k + lane, chunk.end, bit);
    if (digit.is_leader) places[digit.value] += std::uint16_t(__popc(digit.same));
    __syncwarp();
  }
  __syncthreads();
  find_places(shared);
  for (std::uint32_t k = chunk.begin; k < chunk.end; k += kWarp) {
    const Digit digit(from, k + lane, chunk.end, bit);
    if (k + lane < chunk.end)
      to[shared.first[digit.value] + places[digit.value] + __popc(digit.same & lanes_below())] =
          digit.word;
    __syncwarp();
    if (digit.is_leader) places[digit.value] += std::uint16_t(__popc(digit.same));
    __syncwarp();
  }
  __syncthreads();
}

// The whole block: fills words[0] with the reduced key and the place of each entry.
__device__ void make_words(SortShared& shared, const BinEntry* entries, std::uint32_t count) {
  if (threadIdx.x == 0) shared.greatest = shared.greatest_flipped = 0;
  __syncthreads();
  std::uint32_t greatest = 0, greatest_flipped = 0;
  for (std::uint32_t k = threadIdx.x; k < count; k += kThreads) {
    const std::uint32_t key = depth_key_of(entries[k]);
    greatest = max(greatest, key);
    greatest_flipped = max(greatest_flipped, ~key);
  }
  greatest = warp_max(greatest);
  greatest_flipped = warp_max(greatest_flipped);
  if (lane_of_thread() == 0) {
    atomicMax(&shared.greatest, greatest);
    atomicMax(&shared.greatest_flipped, greatest_flipped);
  }
  __syncthreads();
  const std::uint32_t least = ~shared.greatest_flipped, range = shared.greatest - least;
  const int shift = max(32 - kKeyBits - __clz(int(range)), 0);
  for (std::uint32_t k = threadIdx.x; k < count; k += kThreads)
    shared.words[0][k] = (depth_key_of(entries[k]) - least) >> shift << kPlaceBits | k;
  __syncthreads();
}

__device__ std::uint32_t place_of(std::uint32_t word) { return word & ((1u << kPlaceBits) - 1); }

// Brings two neighbors into order whose reduced keys may be the same. True if they were exchanged.
__device__ bool exchange(std::uint32_t* words, const BinEntry* entries) {
  const std::uint32_t a = words[0], b = words[1];
  if (a >> kPlaceBits != b >> kPlaceBits || entries[place_of(a)] < entries[place_of(b)])
    return false;
  words[0] = b;
  words[1] = a;
  return true;
}

// The whole block: odd-even exchanges. True once everything is in order.
__device__ bool exchange_neighbors(std::uint32_t* words, const BinEntry* entries,
                                   std::uint32_t count) {
  for (int round = 0; round < kMostRounds; ++round) {
    bool has_exchanged = false;
    for (std::uint32_t odd = 0; odd < 2; ++odd) {
      for (std::uint32_t k = odd + 2 * threadIdx.x; k + 1 < count; k += 2 * kThreads)
        if (exchange(words + k, entries)) has_exchanged = true;
      __syncthreads();
    }
    if (!__syncthreads_or(has_exchanged)) return true;
  }
  return false;
}

// The whole block: sorts any number of entries where they are. It is a bitonic network whose
// comparators all point the same way: places behind the last entry hold entries that never move.
// There are less than 2^31 entries.
__device__ __noinline__ void sort_in_place(BinEntry* entries, std::uint32_t count) {
  const auto bring_in_order = [&](std::uint32_t a, std::uint32_t b) {
    if (b >= count) return;
    const BinEntry first = entries[a], second = entries[b];
    if (first <= second) return;
    entries[a] = second;
    entries[b] = first;
  };
  for (std::uint32_t half = 1; half < count; half *= 2) {
    // Two sorted runs of `half` entries become one: the second run is taken backwards, ...
    for (std::uint32_t k = threadIdx.x; k < count; k += kThreads) {
      const std::uint32_t run = k / half, offset = k % half;
      if (run % 2 == 0) bring_in_order(k, (run + 2) * half - 1 - offset);
    }
    __syncthreads();
    // ... and then all entries of a half are before those of the other, down to pairs.
    for (std::uint32_t stride = half / 2; stride > 0; stride /= 2) {
      for (std::uint32_t k = threadIdx.x; k < count; k += kThreads)
        if (k / stride % 2 == 0) bring_in_order(k, k + stride);
      __syncthreads();
    }
  }
}

// The whole block: writes rows and words of a bin. `order` has the places of its entries from near
// to far; null: they are in order.
template <int side>
__device__ void write_lists(const Input& in, std::uint32_t bin, std::uint32_t count,
                            const std::uint32_t* order) {
  constexpr int kPerRow = side / kSubtileSide, kSubtiles = kPerRow * kPerRow;
  constexpr int kWordsOfLane = (kSubtiles + kWarp - 1) / kWarp;
  const int lane = lane_of_thread(), bin_x = int(bin) % in.bins_x, bin_y = int(bin) / in.bins_x;
  const std::uint32_t groups = groups_of(count);
  const std::uint32_t begin = in.ranges[bin];
  std::uint32_t* const words = in.words + std::size_t(kSubtiles) * in.first_groups[bin];
  for (std::uint32_t group = threadIdx.x / kWarp; group < groups; group += kWarps) {
    const std::uint32_t k = group * kWarp + lane;
    SubtileBits bits = 0;
    if (k < count) {
      const std::uint32_t row = row_of(in.entries[begin + (order ? place_of(order[k]) : k)]);
      in.rows[begin + k] = row;
      bits = subtile_bits<FastArithmetic>(in.bounds, outline_of(load_in_vectors(in.splats + row)),
                                          in.pixel_rects[row], bin_x, bin_y, side);
    }
    // Bit s of all lanes is the word of sub-tile s, which lane s % 32 writes.
    std::uint32_t own[kWordsOfLane] = {};
#pragma unroll
    for (int s = 0; s < kSubtiles; ++s) {
      const std::uint32_t word = __ballot_sync(kAllLanes, bits >> s & 1);
      if (lane == s % kWarp) own[s / kWarp] = word;
    }
#pragma unroll
    for (int part = 0; part < kWordsOfLane; ++part)
      if (const int s = part * kWarp + lane; s < kSubtiles)
        words[std::size_t(s) * groups + group] = own[part];
  }
}

template <int side>
__global__ void __launch_bounds__(kThreads, kBlocks) sort_bins_kernel(Input in) {
  extern __shared__ __align__(16) unsigned char memory[];
  SortShared& shared = *reinterpret_cast<SortShared*>(memory);
  const std::uint32_t bin = in.order[blockIdx.x];
  const std::uint32_t count = in.ranges[bin + 1] - in.ranges[bin];
  if (count == 0) return;  // the whole block
  BinEntry* const entries = in.entries + in.ranges[bin];
  bool is_done = false;
  if (count <= kMostInShared) {
    make_words(shared, entries, count);
    radix_pass(shared, shared.words[0], shared.words[1], count, kPlaceBits);
    radix_pass(shared, shared.words[1], shared.words[0], count, kPlaceBits + 8);
    is_done = exchange_neighbors(shared.words[0], entries, count);
  }
  if (!is_done) sort_in_place(entries, count);
  write_lists<side>(in, bin, count, is_done ? shared.words[0] : nullptr);
}

}  // namespace

void sort_bins(Context& context, const RenderSettings& settings, Workspace& workspace,
               RenderPass& pass, std::uint32_t capacity) {
  const StageScope scope(context, "bin sort");
  CudaScratch& scratch = pass.scratch<CudaScratch>();
  BinBuffers& bins = scratch.bins;
  // Each bin may have one group that is not full.
  const std::size_t groups = bins.count() + capacity / kEntriesOfWord;
  const std::size_t per_row = std::size_t(bins.side / kSubtileSide);
  bins.rows.resize_discard(capacity);
  bins.words.resize_discard(per_row * per_row * groups);
  const Input in{bins.order.data(),
                 bins.ranges.data(),
                 bins.first_groups.data(),
                 workspace.bin_entries.data(),
                 scratch.view_splats.data(),
                 pass.pixel_rects.data(),
                 settings.bounds,
                 bins.bins_x,
                 bins.rows.data(),
                 bins.words.data()};
  with_bin_side(bins.side, [&](auto side) {
    context.launch_with_shared("the sort of bins", sort_bins_kernel<side()>, bins.count(), kThreads,
                               sizeof(SortShared), in);
  });
}

}  // namespace gs::cuda
