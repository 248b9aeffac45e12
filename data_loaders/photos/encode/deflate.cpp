// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/encode/deflate.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <functional>
#include <queue>
#include <vector>

namespace gs {
namespace {

constexpr int kEndOfBlock = 256, kSymbols = 286;  // literals, the end, lengths of runs
constexpr std::size_t kShortestRun = 8, kLongestRun = 258;
constexpr int kLongestCode = 15, kLongestLengthCode = 7;  // bits

// ---- runs --------------------------------------------------------------------------------------

// Whether the bytes from `at` on repeat the one before it.
bool starts_run(const std::uint8_t* at) {
  std::uint64_t now = 0, before = 0;
  static_assert(sizeof now == kShortestRun);
  std::memcpy(&now, at, sizeof now);
  std::memcpy(&before, at - 1, sizeof before);
  return now == before;
}

// Calls literal(byte) and run(length) for what `bytes` consist of; a run repeats the byte before it.
template <class Literal, class Run>
void for_each_part(std::span<const std::uint8_t> bytes, Literal&& literal, Run&& run) {
  const std::uint8_t* const data = bytes.data();
  const std::size_t size = bytes.size();
  for (std::size_t i = 0; i < size;) {
    if (i == 0 || size - i < kShortestRun || !starts_run(data + i)) {
      literal(data[i++]);
      continue;
    }
    const std::size_t most = std::min(kLongestRun, size - i);
    std::size_t length = kShortestRun;
    while (length < most && data[i + length] == data[i]) ++length;
    run(length);
    i += length;
  }
}

// The symbol of a length, and what follows it.                              RFC 1951, 3.2.5
struct RunCode {
  int symbol, extra_bits;
  std::uint32_t extra;
};

RunCode run_code(std::size_t length) {
  if (length == kLongestRun) return {285, 0, 0};
  int bits = 0;  // lengths from 3 on, in four steps of a power of two at a time
  while (((length - 3) >> bits) >= 8) ++bits;
  const std::size_t step = (length - 3) >> bits;
  return {257 + 4 * bits + int(step), bits,
          std::uint32_t((length - 3) & ((std::size_t(1) << bits) - 1))};
}

// ---- codes                                                                Huffman 1952 ---------

// The lengths of the codes that suit these counts best, 0 for symbols that do not occur. At least
// two occur.
std::vector<int> best_lengths(const std::vector<std::uint32_t>& counts) {
  using Node = std::pair<std::uint64_t, int>;  // how often its symbols occur, its index
  std::priority_queue<Node, std::vector<Node>, std::greater<>> nodes;
  for (int i = 0; i < int(counts.size()); ++i)
    if (counts[std::size_t(i)]) nodes.push({counts[std::size_t(i)], i});
  std::vector<int> parents(2 * counts.size(), 0);
  int next = int(counts.size());
  for (; nodes.size() > 1; ++next) {
    const Node a = nodes.top();
    nodes.pop();
    const Node b = nodes.top();
    nodes.pop();
    parents[std::size_t(a.second)] = parents[std::size_t(b.second)] = next;
    nodes.push({a.first + b.first, next});
  }
  std::vector<int> depths(std::size_t(next), 0);
  for (int i = next - 2; i >= 0; --i)
    if (const int parent = parents[std::size_t(i)])
      depths[std::size_t(i)] = depths[std::size_t(parent)] + 1;
  depths.resize(counts.size());
  return depths;
}

// Such lengths up to `longest`: counts that differ less give codes that differ less.
std::vector<int> code_lengths(std::vector<std::uint32_t> counts, int longest) {
  for (;;) {
    std::vector<int> lengths = best_lengths(counts);
    if (*std::max_element(lengths.begin(), lengths.end()) <= longest) return lengths;
    for (std::uint32_t& count : counts) count = (count + 1) / 2;
  }
}

struct Code {
  std::uint32_t bits = 0;  // as they are written, the first one lowest
  int length = 0;
};

// The codes of these lengths.                                               RFC 1951, 3.2.2
std::vector<Code> codes_of(const std::vector<int>& lengths) {
  std::array<std::uint32_t, kLongestCode + 2> next{};  // by length
  for (const int length : lengths)
    if (length) ++next[std::size_t(length) + 1];
  for (std::size_t i = 1; i < next.size(); ++i) next[i] = (next[i] + next[i - 1]) << 1;
  std::vector<Code> codes(lengths.size());
  for (std::size_t i = 0; i < lengths.size(); ++i) {
    if (!lengths[i]) continue;
    const std::uint32_t code = next[std::size_t(lengths[i])]++;
    for (int bit = 0; bit < lengths[i]; ++bit)
      codes[i].bits |= (code >> bit & 1) << (lengths[i] - 1 - bit);
    codes[i].length = lengths[i];
  }
  return codes;
}

// ---- bits --------------------------------------------------------------------------------------

/// Appends bits to a string, at most `most_bytes` bytes of them.
class BitWriter {
 public:
  BitWriter(std::string& out, std::size_t most_bytes) : out_(out), size_(out.size()) {
    out.resize(size_ + most_bytes + sizeof held_);
  }

  /// At most 32 bits, the lowest one first.
  void put(std::uint32_t bits, int count) {
    held_ |= std::uint64_t(bits) << count_;
    count_ += count;
    if (count_ >= 32) move_bytes(4);
  }
  void put(const Code& code) { put(code.bits, code.length); }
  /// Ends the last byte with zeros.
  void finish() {
    move_bytes((count_ + 7) / 8);
    out_.resize(size_);
  }

 private:
  void move_bytes(int count) {
    for (int i = 0; i < count; ++i) out_[size_ + std::size_t(i)] = char(held_ >> 8 * i & 255);
    size_ += std::size_t(count);
    held_ >>= 8 * count;
    count_ -= 8 * count;
  }

  std::string& out_;
  std::size_t size_;  // of what is written
  std::uint64_t held_ = 0;
  int count_ = 0;  // bits held
};

// The lengths of all codes: of bytes and runs, and of the one distance, 1.   RFC 1951, 3.2.7
void put_lengths(const std::vector<int>& lengths, BitWriter& out) {
  constexpr std::array<std::size_t, 19> kOrder = {16, 17, 18, 0, 8,  7, 9,  6, 10, 5,
                                                  11, 4,  12, 3, 13, 2, 14, 1, 15};
  constexpr std::size_t kZeros = 18;  // symbol of 11 to 138 lengths of 0
  struct Part {
    std::size_t symbol, zeros;
  };
  std::vector<int> all = lengths;
  all.push_back(1);
  std::vector<Part> parts;
  for (std::size_t i = 0; i < all.size();) {
    const auto other = std::find_if(all.begin() + std::ptrdiff_t(i), all.end(), std::identity());
    const auto zeros = std::min<std::size_t>(std::size_t(other - all.begin()) - i, 138);
    parts.push_back(zeros >= 11 ? Part{kZeros, zeros} : Part{std::size_t(all[i]), 0});
    i += zeros >= 11 ? zeros : 1;
  }
  std::vector<std::uint32_t> counts(kOrder.size(), 0);
  for (const Part& part : parts) ++counts[part.symbol];
  const std::vector<int> code_lengths_of_lengths = code_lengths(counts, kLongestLengthCode);
  const std::vector<Code> codes = codes_of(code_lengths_of_lengths);
  out.put(kSymbols - 257, 5);
  out.put(0, 5);  // one distance
  out.put(std::uint32_t(kOrder.size()) - 4, 4);
  for (const std::size_t symbol : kOrder)
    out.put(std::uint32_t(code_lengths_of_lengths[symbol]), 3);
  for (const Part& part : parts) {
    out.put(codes[part.symbol]);
    if (part.symbol == kZeros) out.put(std::uint32_t(part.zeros) - 11, 7);
  }
}

}  // namespace

void append_deflated(std::span<const std::uint8_t> bytes, bool is_last, std::string& out) {
  std::vector<std::uint32_t> counts(kSymbols, 0);
  for_each_part(
      bytes, [&](std::uint8_t byte) { ++counts[byte]; },
      [&](std::size_t length) { ++counts[std::size_t(run_code(length).symbol)]; });
  counts[kEndOfBlock] = 1;
  counts[0] += bytes.empty();  // a code has two symbols
  const std::vector<int> lengths = code_lengths(counts, kLongestCode);
  const std::vector<Code> codes = codes_of(lengths);

  constexpr std::size_t kMostBytesForLengths = 512;
  BitWriter writer(out, 2 * bytes.size() + kMostBytesForLengths);  // a code has less than 16 bits
  writer.put(is_last ? 1 : 0, 1);
  writer.put(2, 2);  // codes of its own
  put_lengths(lengths, writer);
  for_each_part(
      bytes, [&](std::uint8_t byte) { writer.put(codes[byte]); },
      [&](std::size_t length) {
        const RunCode run = run_code(length);
        writer.put(codes[std::size_t(run.symbol)]);
        writer.put(run.extra, run.extra_bits);
        writer.put(0, 1);  // the distance 1
      });
  writer.put(codes[kEndOfBlock]);
  if (!is_last) writer.put(0, 3);  // an empty block of plain bytes begins at a whole byte
  writer.finish();
  if (!is_last) out.append("\0\0\xff\xff", 4);
}

}  // namespace gs
