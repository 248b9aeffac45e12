// SPDX-License-Identifier: Apache-2.0
// Shared by the row operations, stages 9 and 10: the gather of whole rows, the order of rows by
// keys, and the room for both.
#pragma once

#include <algorithm>
#include <type_traits>

#include "cuda/device/context.cuh"
#include "gs_core/buffer.h"
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
class BorrowedRoom {
 public:
  static constexpr int kWordsOfRow = sizeof(Splat) / sizeof(std::uint32_t);

  BorrowedRoom(Buffer<Splat>& splats, Buffer<Rect>& pixel_rects)
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
  RowOrderWorkspace(Memory& memory, BorrowedRoom& room)
      : bounds(memory), cub(memory), room_(room) {}

  /// The sort keys of so many rows, not set yet.
  Span<std::uint64_t> make_keys(std::size_t count) {
    static_assert(2 * sizeof(std::uint64_t) <= sizeof(Splat));  // two arrays of keys
    keys_ = {reinterpret_cast<std::uint64_t*>(room_.words(count)), count};
    return keys_;
  }
  /// morton.cu: the numbers of all rows, sorted by the lowest `bits` bits of their keys, ascending;
  /// equal keys by row number. Overwrites the keys. The result is valid until the next call.
  Span<const std::uint32_t> sort(Context& context, const char* stage, int bits);
  void release();

  Buffer<Bounds> bounds;  // (1)
  Buffer<std::uint8_t> cub;

 private:
  BorrowedRoom& room_;
  Span<std::uint64_t> keys_;
};

/// 10  morton.cu: the numbers of all rows along the Morton curve of the means, in their bounding
/// cube, equal codes by row number. Rows in space and time are ordered by their bin of time first;
/// both other arrays are empty where rows have no time. The result lies in `workspace` like that of
/// its sort().
Span<const std::uint32_t> morton_order(Context& context, RowOrderWorkspace& workspace,
                                       Span<const Vec3f> means, Span<const float> time_means,
                                       Span<const float> log_time_scales);

inline constexpr int kGatherThreads = 256;  // threads of a block, and rows that it copies

/// What rows of T are copied in: words of 4 bytes, or of 2 for some HalfMoments.
template <class T>
using WordOf =
    std::conditional_t<sizeof(T) % sizeof(std::uint32_t) == 0, std::uint32_t, std::uint16_t>;
template <class T>
inline constexpr int kWordsOf = sizeof(T) / sizeof(WordOf<T>);
template <class T>
WordOf<T>* words_of(const Buffer<T>& rows) {
  static_assert(sizeof(T) % sizeof(WordOf<T>) == 0);
  return reinterpret_cast<WordOf<T>*>(rows.data());
}

/// Copies `copied` words of each row. Rows lie words_apart_from words apart in `from`, and
/// words_apart_to in `to`. Row i comes from row source[i], or from row i without a source.
/// A block takes kGatherThreads rows. Its threads take one word after another, so that neighboring
/// threads read and write neighboring words.
template <class Word>
__global__ void copy_columns_kernel(unsigned copied, const Word* from, unsigned words_apart_from,
                                    const std::uint32_t* source, std::size_t rows, Word* to,
                                    unsigned words_apart_to) {
  const std::size_t first = std::size_t(blockIdx.x) * kGatherThreads;
  const unsigned words = unsigned(min_of(rows - first, std::size_t(kGatherThreads))) * copied;
  for (unsigned k = threadIdx.x; k < words; k += kGatherThreads) {
    const std::size_t row = first + k / copied;
    const unsigned word = k % copied;
    to[row * words_apart_to + word] =
        from[std::size_t(source ? source[row] : row) * words_apart_from + word];
  }
}

/// Gathers arrays one by one through borrowed room. Where a row has more words than the room has,
/// it is gathered in several passes of some of its words.
class RowGather {
 public:
  RowGather(Context& context, BorrowedRoom& room) : context_(context), room_(room) {}

  /// Reserves memory to gather up to so many rows of the array, after which gather() cannot fail.
  template <class T>
  void reserve(Buffer<T>& array, std::size_t count) {
    array.reserve(count);
    room_.reserve(count);
  }
  /// The array becomes `count` >= source.size rows: array[source[i]] for each i, then rows of
  /// zeros.
  template <class T>
  void gather(Buffer<T>& array, Span<const std::uint32_t> source, std::size_t count) {
    array.reserve(count);
    gather_columns(words_of(array), kWordsOf<T>, source);
    array.resize(count);
    if (count > source.size)
      array.memory().fill_zero(array.data() + source.size, (count - source.size) * sizeof(T));
  }
  template <class T>
  void gather(Buffer<T>& array, Span<const std::uint32_t> source) {
    gather(array, source, source.size);
  }

 private:
  // A pass changes no word that a later one reads.
  template <class Word>
  void gather_columns(Word* rows, unsigned words, Span<const std::uint32_t> source) {
    Word* const room = reinterpret_cast<Word*>(room_.words(source.size));
    const std::size_t blocks = blocks_for(source.size, kGatherThreads);
    for (unsigned first = 0; first < words; first += BorrowedRoom::kWordsOfRow) {
      const unsigned copied = min_of(words - first, unsigned(BorrowedRoom::kWordsOfRow));
      context_.launch("gather", copy_columns_kernel<Word>, blocks, kGatherThreads, copied,
                      rows + first, words, source.data, source.size, room, copied);
      context_.launch("gather", copy_columns_kernel<Word>, blocks, kGatherThreads, copied, room,
                      copied, nullptr, source.size, rows + first, words);
    }
  }

  Context& context_;
  BorrowedRoom& room_;
};

}  // namespace gs::cuda
