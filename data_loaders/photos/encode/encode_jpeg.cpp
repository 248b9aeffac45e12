// SPDX-License-Identifier: Apache-2.0
// Large JPEGs made on all threads: strips of rows are encoded as pictures of their own and put
// together with restart markers between them, at which a decoder starts afresh as each strip did.
#include <algorithm>
#include <optional>

#include "data_loaders/photos/encode/encode_jpeg.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr std::size_t kStripPixels = 1 << 17, kLeastPixels = 1 << 20;  // smaller ones stay whole
constexpr int kStripRows = 16;              // a multiple of the rows of every kind of block
constexpr std::size_t kMostBlocks = 65535;  // between two restart markers

// Markers                                                                   ITU-T T.81, B.1.1.3
constexpr std::uint8_t kMarker = 0xFF, kBaseline = 0xC0, kEnd = 0xD9, kScan = 0xDA,
                       kRestartInterval = 0xDD, kFirstRestart = 0xD0;

using Bytes = std::vector<std::uint8_t>;

// Where the parts of a baseline JPEG with one scan begin.
struct JpegParts {
  std::size_t frame = 0, scan = 0, data = 0;  // the segments, and what follows the last one
};

std::optional<JpegParts> parts_of(const Bytes& jpeg) {
  constexpr std::size_t kEndBytes = 2;
  JpegParts parts;
  for (std::size_t at = 2; at + 4 < jpeg.size() && jpeg[at] == kMarker;) {
    const std::uint8_t kind = jpeg[at + 1];
    const std::size_t next = at + 2 + std::size_t(jpeg[at + 2] << 8 | jpeg[at + 3]);
    if (kind == kBaseline) parts.frame = at;
    if (kind == kScan) {
      parts.scan = at;
      parts.data = next;
      break;
    }
    at = next;
  }
  const bool is_whole = parts.frame && parts.scan && parts.data + kEndBytes <= jpeg.size() &&
                        jpeg[jpeg.size() - 1] == kEnd;
  return is_whole ? std::optional(parts) : std::nullopt;
}

// Of a frame segment: behind marker, length and bits of a sample.             T.81, B.2.2
void set_height(Bytes& jpeg, const JpegParts& parts, int height) {
  jpeg[parts.frame + 5] = std::uint8_t(height >> 8);
  jpeg[parts.frame + 6] = std::uint8_t(height);
}

// How many blocks, each of all colors, a strip of so many rows has.
std::size_t blocks_in(const Bytes& jpeg, const JpegParts& parts, int width, int rows) {
  int across = 1, down = 1;  // samples of the finest color for one of the coarsest
  for (int color = 0; color < jpeg[parts.frame + 9]; ++color) {
    const std::uint8_t factors = jpeg[parts.frame + 11 + 3 * std::size_t(color)];
    across = std::max(across, factors >> 4);
    down = std::max(down, factors & 15);
  }
  const int block_width = 8 * across, block_height = 8 * down;
  return std::size_t((width + block_width - 1) / block_width) * std::size_t(rows / block_height);
}

// The strips, of `rows` rows each but the last, as one picture; none where they do not fit together.
std::optional<Bytes> joined(std::vector<Bytes> strips, const Image8& image, int rows) {
  std::vector<JpegParts> parts;
  for (Bytes& strip : strips) {
    const std::optional<JpegParts> found = parts_of(strip);
    if (!found) return std::nullopt;
    set_height(strip, *found, image.height);
    parts.push_back(*found);
    const auto head_size = std::ptrdiff_t(found->data);
    if (found->data != parts[0].data ||
        !std::equal(strip.begin(), strip.begin() + head_size, strips[0].begin()))
      return std::nullopt;
  }
  const std::size_t blocks = blocks_in(strips[0], parts[0], image.width, rows);
  if (blocks > kMostBlocks) return std::nullopt;
  const auto head = strips[0].begin(), scan = head + std::ptrdiff_t(parts[0].scan);
  Bytes jpeg(head, scan);
  jpeg.insert(jpeg.end(),
              {kMarker, kRestartInterval, 0, 4, std::uint8_t(blocks >> 8), std::uint8_t(blocks)});
  jpeg.insert(jpeg.end(), scan, head + std::ptrdiff_t(parts[0].data));
  for (std::size_t i = 0; i < strips.size(); ++i) {
    jpeg.insert(jpeg.end(), strips[i].begin() + std::ptrdiff_t(parts[i].data), strips[i].end() - 2);
    const bool is_last = i + 1 == strips.size();
    jpeg.insert(jpeg.end(), {kMarker, is_last ? kEnd : std::uint8_t(kFirstRestart + i % 8)});
  }
  return jpeg;
}

Image8 rows_of(const Image8& image, int begin, int end) {
  Image8 strip(image.width, 0, image.channels);
  const auto at = [&](int y) {
    return image.pixels.begin() + std::ptrdiff_t(y) * image.width * image.channels;
  };
  strip.height = end - begin;
  strip.pixels.assign(at(begin), at(end));
  return strip;
}

}  // namespace

std::vector<std::uint8_t> encode_jpeg(const Image8& image, int quality) {
  if (image.pixels.size() / 3 < kLeastPixels) return encode_jpeg_alone(image, quality);
  const int blocks = int(kStripPixels / std::size_t(image.width)) / kStripRows;
  const int rows = kStripRows * std::max(blocks, 1);
  std::vector<Bytes> strips(std::size_t((image.height + rows - 1) / rows));
  parallel_for(strips.size(), 1, [&](std::size_t i) {
    const int begin = int(i) * rows;
    strips[i] =
        encode_jpeg_alone(rows_of(image, begin, std::min(begin + rows, image.height)), quality);
  });
  if (std::optional<Bytes> jpeg = joined(std::move(strips), image, rows)) return *std::move(jpeg);
  return encode_jpeg_alone(image, quality);
}

}  // namespace gs
