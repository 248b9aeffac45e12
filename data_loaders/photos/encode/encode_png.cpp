// SPDX-License-Identifier: Apache-2.0
// PNG (W3C 2003, second edition): strips of rows are filtered and compressed side by side, each
// into a chunk of its own.
#include "data_loaders/photos/encode/encode_png.h"

#include <algorithm>
#include <cstdlib>
#include <string>
#include <string_view>

#include "data_loaders/photos/encode/deflate.h"
#include "gs_core/error.h"
#include "gs_core/system/crc32.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr std::size_t kStripBytes = 1 << 16;  // of pixels: a code of its own costs 100 bytes
constexpr std::uint32_t kAdlerBase = 65521;

using Bytes = std::vector<std::uint8_t>;

void put_big(std::uint32_t value, std::string& out) {
  for (int shift = 24; shift >= 0; shift -= 8) out += char(value >> shift & 255);
}

std::string chunk(std::string_view type, std::string_view content) {
  std::string bytes;
  put_big(std::uint32_t(content.size()), bytes);
  (bytes += type) += content;
  put_big(crc32_of(std::string_view(bytes).substr(4)), bytes);
  return bytes;
}

std::string header_chunk(const Image8& image) {
  std::string fields;
  put_big(std::uint32_t(image.width), fields);
  put_big(std::uint32_t(image.height), fields);
  const char color = image.channels == 1 ? 0 : image.channels == 3 ? 2 : 6;
  fields += {8, color, 0, 0, 0};  // bits; nothing interlaced
  return chunk("IHDR", fields);
}

/// Text that is neither compressed nor of a language.   XMP part 3, 1.1.5
std::string xmp_chunk(const std::string& xmp) {
  if (xmp.empty()) return {};
  return chunk("iTXt", "XML:com.adobe.xmp" + std::string(5, '\0') + xmp);
}

// ---- filters: what a byte is after its neighbors are known                PNG 9.2 --------------

/// The nearest of left, above and their corner to left + above - corner.
int paeth(int left, int above, int corner) {
  const int to_left = std::abs(above - corner), to_above = std::abs(left - corner);
  const int to_corner = std::abs(left + above - 2 * corner);
  const int other = to_above <= to_corner ? above : corner;
  return to_left <= std::min(to_above, to_corner) ? left : other;
}

// Writes value(i) for each byte of a row. Returns the sum of their sizes, as signed numbers.
template <class Value>
int filter_row(std::size_t size, std::uint8_t* out, Value&& value) {
  int sum = 0;
  for (std::size_t i = 0; i < size; ++i) {
    out[i] = std::uint8_t(value(i));
    sum += std::abs(int(std::int8_t(out[i])));
  }
  return sum;
}

/// Filters the rows of one picture.
class RowFilters {
 public:
  explicit RowFilters(const Image8& image)
      : image_(image), channels_(std::size_t(image.channels)),
        size_(channels_ * std::size_t(image.width)), row_(channels_ + size_), above_(row_),
        best_(size_), other_(size_) {}

  /// Appends the number of the filter that leaves the smallest bytes, and the row.
  void append(int y, Bytes& out) {
    load(y - 1, above_);
    load(y, row_);
    const std::uint8_t *now = row_.data() + channels_, *left = row_.data();
    const std::uint8_t *above = above_.data() + channels_, *corner = above_.data();
    constexpr std::uint8_t kLeft = 1, kAbove = 2, kMean = 3, kPaeth = 4;
    std::uint8_t kind = kLeft;
    int least = filter_row(size_, best_.data(), [&](std::size_t i) { return now[i] - left[i]; });
    const auto attempt = [&](std::uint8_t filter, const auto& value) {
      const int sum = filter_row(size_, other_.data(), value);
      if (sum >= least) return;
      kind = filter;
      least = sum;
      best_.swap(other_);
    };
    attempt(kAbove, [&](std::size_t i) { return now[i] - above[i]; });
    attempt(kMean, [&](std::size_t i) { return now[i] - (left[i] + above[i]) / 2; });
    attempt(kPaeth, [&](std::size_t i) { return now[i] - paeth(left[i], above[i], corner[i]); });
    out.push_back(kind);
    out.insert(out.end(), best_.begin(), best_.end());
  }

 private:
  // A row behind a pixel of zeros. That above the first one is all zeros.
  void load(int y, Bytes& row) const {
    if (y < 0) return std::fill(row.begin(), row.end(), std::uint8_t(0));
    std::copy_n(image_.pixels.begin() + std::ptrdiff_t(std::size_t(y) * size_), size_,
                row.begin() + std::ptrdiff_t(channels_));
  }

  const Image8& image_;
  std::size_t channels_, size_;
  Bytes row_, above_, best_, other_;
};

// ---- the checksum of all filtered rows                                    RFC 1950 -------------

struct Adler {
  std::uint32_t a = 1, b = 0;
  std::size_t size = 0;
};

Adler adler_of(const Bytes& bytes) {
  constexpr std::size_t kAtATime = 5552;  // as many as 32 bits hold
  Adler sum;
  for (std::size_t begin = 0; begin < bytes.size(); begin += kAtATime) {
    const std::size_t end = std::min(bytes.size(), begin + kAtATime);
    for (std::size_t i = begin; i < end; ++i) sum.b += sum.a += bytes[i];
    sum.a %= kAdlerBase;
    sum.b %= kAdlerBase;
  }
  sum.size = bytes.size();
  return sum;
}

// Of the bytes of one behind those of the other.
Adler joined(const Adler& first, const Adler& second) {
  const std::uint64_t b =
      first.b + second.b + std::uint64_t(second.size % kAdlerBase) * (first.a + kAdlerBase - 1);
  return {(first.a + second.a + kAdlerBase - 1) % kAdlerBase, std::uint32_t(b % kAdlerBase),
          first.size + second.size};
}

struct Strip {
  std::string data;
  Adler sum;
};

Strip strip_of(const Image8& image, int begin, int end) {
  RowFilters filters(image);
  Bytes rows;
  for (int y = begin; y < end; ++y) filters.append(y, rows);
  Strip strip{begin == 0 ? "\x78\x01" : "", adler_of(rows)};
  strip.data.reserve(rows.size());
  append_deflated(rows, end == image.height, strip.data);
  return strip;
}

}  // namespace

std::vector<std::uint8_t> encode_png(const Image8& image, const std::string& xmp) {
  GS_CHECK(image.channels == 1 || image.channels == 3 || image.channels == 4);
  const std::size_t row_bytes = std::size_t(image.width) * std::size_t(image.channels);
  const int rows = int(std::max<std::size_t>(kStripBytes / row_bytes, 1));
  std::vector<Strip> strips(std::size_t((image.height + rows - 1) / rows));
  parallel_for(strips.size(), 1, [&](std::size_t i) {
    const int begin = int(i) * rows;
    strips[i] = strip_of(image, begin, std::min(begin + rows, image.height));
  });
  Adler sum;
  for (const Strip& strip : strips) sum = joined(sum, strip.sum);
  put_big(sum.b << 16 | sum.a, strips.back().data);

  parallel_for(strips.size(), 1,
               [&](std::size_t i) { strips[i].data = chunk("IDAT", strips[i].data); });
  const std::string start = "\x89PNG\r\n\x1a\n" + header_chunk(image) + xmp_chunk(xmp);
  const std::string end = chunk("IEND", "");
  std::vector<std::uint8_t> bytes(start.begin(), start.end());
  for (const Strip& strip : strips) bytes.insert(bytes.end(), strip.data.begin(), strip.data.end());
  bytes.insert(bytes.end(), end.begin(), end.end());
  return bytes;
}

void write_png(const std::filesystem::path& path, const Image8& image, const std::string& xmp) {
  GS_CHECK(!image.empty());
  const std::vector<std::uint8_t> bytes = encode_png(image, xmp);
  AtomicFile file(path);
  file.write(bytes.data(), bytes.size());
  file.commit();
}

}  // namespace gs
