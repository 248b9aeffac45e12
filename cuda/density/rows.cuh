// SPDX-License-Identifier: Apache-2.0
// Shared by the row operations, stages 9 and 10: the gather of whole rows, the order of rows by
// keys, and the memory that both borrow.
#pragma once

#include <algorithm>
#include <utility>

#include "cuda/device/context.cuh"
#include "gs_core/buffer.h"
#include "gs_core/math/render/splat.h"
#include "gs_core/math/render/tile_bounds.h"
#include "gs_core/types.h"

namespace gs::cuda {

/// The smallest box around some points. An empty box has its low corner above its high corner.
struct Bounds {
  Vec3f low, high;
};

/// Memory that row operations borrow from the step: the splats of its pass and their rectangles. No
/// step runs while rows are changed, and nobody reads either after it. So the sort keys, the sorted
/// rows and the gathers need no memory of their own. Each use destroys what the one before has
/// left.
class BorrowedMemory {
 public:
  static constexpr int kWordsOfRow = sizeof(Splat) / sizeof(std::uint32_t);

  BorrowedMemory(Buffer<Splat>& splats, Buffer<Rect>& pixel_rects)
      : splats_(splats), pixel_rects_(pixel_rects) {}

  /// Makes room for kWordsOfRow words of each of `rows` rows.
  void reserve(std::size_t rows) {
    if (splats_.size() < rows) splats_.resize_discard(rows);
  }
  std::uint32_t* words(std::size_t rows) {
    reserve(rows);
    return reinterpret_cast<std::uint32_t*>(splats_.data());
  }
  /// Two arrays of so many row numbers, one after the other. They lie in the rectangles, so that
  /// gathers may use words() meanwhile.
  std::uint32_t* row_numbers(std::size_t rows) {
    static_assert(sizeof(Rect) == 2 * sizeof(std::uint32_t));
    if (pixel_rects_.size() < rows) pixel_rects_.resize_discard(rows);
    return reinterpret_cast<std::uint32_t*>(pixel_rects_.data());
  }

 private:
  Buffer<Splat>& splats_;
  Buffer<Rect>& pixel_rects_;
};

/// Buffers of sort_rows() and morton_order().
class RowOrderWorkspace {
 public:
  RowOrderWorkspace(Memory& memory, BorrowedMemory& borrowed)
      : bounds(memory), cub(memory), borrowed_(borrowed) {}

  /// The sort keys of so many rows, not set yet.
  Span<std::uint64_t> make_keys(std::size_t count) {
    static_assert(2 * sizeof(std::uint64_t) <= sizeof(Splat));  // two arrays of keys
    keys_ = {reinterpret_cast<std::uint64_t*>(borrowed_.words(count)), count};
    return keys_;
  }
  /// morton.cu: the numbers of all rows, sorted by the lowest `bits` bits of their keys, ascending;
  /// equal keys by row number. Overwrites the keys. The result is valid until the next call.
  Span<const std::uint32_t> sort(Context& context, const char* stage, int bits);
  void release();

  Buffer<Bounds> bounds;  // (1)
  Buffer<std::uint8_t> cub;

 private:
  BorrowedMemory& borrowed_;
  Span<std::uint64_t> keys_;
};

/// 10  morton.cu: the numbers of all rows along the Morton curve of the means, in their bounding
/// cube, equal codes by row number. Rows in space and time are ordered by their bin of time first;
/// both other arrays are empty where rows have no time. The result lies in `workspace` like that of
/// its sort().
Span<const std::uint32_t> morton_order(Context& context, RowOrderWorkspace& workspace,
                                       Span<const Vec3f> means, Span<const float> time_means,
                                       Span<const float> log_time_scales);

inline constexpr int kRowThreads = 256;  // rows are independent: any size that fills the GPU

/// The number of this thread among those of launch_rows().
__device__ inline std::size_t row_of_thread() {
  return std::size_t(blockIdx.x) * kRowThreads + threadIdx.x;
}

/// Launches a thread for each of `count` rows.
template <class... Parameters, class... Arguments>
void launch_rows(Context& context, const char* stage, void (*kernel)(Parameters...),
                 std::size_t count, Arguments&&... arguments) {
  context.launch(stage, kernel, blocks_for(count, kRowThreads), kRowThreads,
                 std::forward<Arguments>(arguments)...);
}

/// Calls f(words, words of a row): rows consist of words of 4 bytes, or of 2 for some HalfMoments.
template <class F>
void with_words(const ByteBuffer& rows, F&& f) {
  const auto call = [&]<class Word>(Word* words) {
    f(words, unsigned(rows.row_bytes() / sizeof(Word)));
  };
  if (rows.row_bytes() % sizeof(std::uint32_t) == 0)
    call(reinterpret_cast<std::uint32_t*>(rows.bytes()));
  else
    call(reinterpret_cast<std::uint16_t*>(rows.bytes()));
}

/// Copies `copied` words of each row. Rows lie words_apart_from words apart in `from`, and
/// words_apart_to in `to`. Row i comes from row source[i], or from row i without a source.
/// A block takes kRowThreads rows. Its threads take one word after another, so that neighboring
/// threads read and write neighboring words.
template <class Word>
__global__ void copy_columns_kernel(unsigned copied, const Word* from, unsigned words_apart_from,
                                    const std::uint32_t* source, std::size_t rows, Word* to,
                                    unsigned words_apart_to) {
  const std::size_t first = std::size_t(blockIdx.x) * kRowThreads;
  const unsigned words = unsigned(min_of(rows - first, std::size_t(kRowThreads))) * copied;
  for (unsigned k = threadIdx.x; k < words; k += kRowThreads) {
    const std::size_t row = first + k / copied;
    const unsigned word = k % copied;
    to[row * words_apart_to + word] =
        from[std::size_t(source ? source[row] : row) * words_apart_from + word];
  }
}

/// The rows become `count` >= source.size ones: row source[i] for each i, then zeros. They are
/// gathered through borrowed memory. Where a row has more words than that has, it is gathered in
/// several passes of some of its words; a pass changes no word that a later one reads.
inline void gather(Context& context, BorrowedMemory& memory, ByteBuffer& rows,
                   Span<const std::uint32_t> source, std::size_t count) {
  rows.reserve(count);
  with_words(rows, [&]<class Word>(Word* words, unsigned in_row) {
    Word* const borrowed = reinterpret_cast<Word*>(memory.words(source.size));
    for (unsigned first = 0; first < in_row; first += BorrowedMemory::kWordsOfRow) {
      const unsigned copied = min_of(in_row - first, unsigned(BorrowedMemory::kWordsOfRow));
      launch_rows(context, "gather", copy_columns_kernel<Word>, source.size, copied, words + first,
                  in_row, source.data, source.size, borrowed, copied);
      launch_rows(context, "gather", copy_columns_kernel<Word>, source.size, copied, borrowed,
                  copied, nullptr, source.size, words + first, in_row);
    }
  });
  rows.resize(count);
  rows.zero_from(source.size);
}

}  // namespace gs::cuda
