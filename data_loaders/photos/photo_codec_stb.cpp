// SPDX-License-Identifier: Apache-2.0
// Photos through stb_image, for machines without OpenImageIO: JPEG and PNG.
#define STB_IMAGE_IMPLEMENTATION
#define STB_IMAGE_STATIC
#define STBI_ONLY_JPEG
#define STBI_ONLY_PNG
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"  // of a single-header library
#include <stb_image.h>
#pragma GCC diagnostic pop

#include <algorithm>
#include <climits>
#include <memory>
#include <numeric>

#include "data_loaders/photos/encode/encode_jpeg.h"
#include "data_loaders/photos/exif_tags.h"
#include "data_loaders/photos/photo_codec.h"
#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"

namespace gs {
namespace {

constexpr std::uint8_t kProgressiveFrame = 0xC2, kHuffmanTables = 0xC4, kEndOfImage = 0xD9,
                       kStartOfScan = 0xDA;
constexpr std::size_t kPngSignature = 8;
constexpr std::uint64_t kHeadBytes = 1 << 20;  // in which most files have all before their pixels

/// The Huffman tables of a JPEG up to a place in the file. stb_image 2.27 relies on what is checked
/// here: it counts more than 256 symbols into memory that is not theirs, and takes any memory for a
/// table that is missing.
class HuffmanTables {
 public:
  /// Takes a DHT segment (ITU-T T.81, B.2.4.2). False where it is damaged.
  bool define(const std::uint8_t* segment, std::size_t size) {
    constexpr std::size_t kLengths = 16, kMostSymbols = 256;
    for (std::size_t at = 0; at < size;) {
      if (size - at < 1 + kLengths) return false;
      const int kind = segment[at] >> 4, number = segment[at] & 15;
      const std::uint8_t* const counts = segment + at + 1;
      const std::size_t symbols = std::accumulate(counts, counts + kLengths, std::size_t(0));
      if (kind >= kKinds || number >= kNumbers) return false;
      if (symbols > kMostSymbols || symbols > size - at - 1 - kLengths) return false;
      is_defined_[kind][number] = true;
      at += 1 + kLengths + symbols;
    }
    return true;
  }
  /// Whether those that a scan names in its SOS segment (B.2.3) are there. In a progressive JPEG a
  /// scan has either DC or AC coefficients, and later bits of DC need no table (G.1.2).
  bool suffice_for(const std::uint8_t* scan, std::size_t size, bool is_progressive) const {
    const std::size_t components = size > 0 ? scan[0] : 0, bands = 1 + 2 * components;
    if (size < bands + 3) return false;
    const bool has_dc = scan[bands] == 0, is_first = scan[bands + 2] >> 4 == 0;
    const bool takes_dc = !is_progressive || (has_dc && is_first);
    const bool takes_ac = !is_progressive || !has_dc;
    for (std::size_t i = 0; i < components; ++i) {
      const int dc = scan[2 + 2 * i] >> 4, ac = scan[2 + 2 * i] & 15;
      if (takes_dc && !(dc < kNumbers && is_defined_[0][dc])) return false;
      if (takes_ac && !(ac < kNumbers && is_defined_[1][ac])) return false;
    }
    return true;
  }

 private:
  static constexpr int kKinds = 2, kNumbers = 4;  // DC and AC, four of each
  bool is_defined_[kKinds][kNumbers] = {};
};

std::size_t load_big(const std::uint8_t* bytes) {
  std::size_t value = 0;
  for (int i = 0; i < 4; ++i) value = value << 8 | bytes[i];
  return value;
}

bool is_jpeg(const std::uint8_t* bytes, std::size_t size) {
  return size >= 2 && bytes[0] == 0xFF && bytes[1] == 0xD8;
}

/// Whether a JPEG reaches a marker. stb_image fills what is missing with gray and says nothing. Throws
/// Error for damaged or missing Huffman tables before it. Walks the segments; in the entropy-coded data behind a
/// start of scan, FF is always followed by 00 or a restart marker (ITU-T T.81, B.1.1).
bool reaches(std::uint8_t last, const std::filesystem::path& path, const std::uint8_t* bytes,
             std::size_t size) {
  HuffmanTables tables;
  bool is_progressive = false;
  std::size_t at = 2;  // behind the start-of-image marker
  while (at + 1 < size) {
    if (bytes[at] != 0xFF) {
      ++at;  // entropy-coded data
      continue;
    }
    const std::uint8_t marker = bytes[at + 1];
    const bool stands_alone = marker == 0x00 || (marker >= 0xD0 && marker <= 0xD8);
    if (marker == last) return true;
    if (marker == kEndOfImage) return false;
    if (marker == 0xFF) {
      ++at;  // a fill byte
    } else if (stands_alone) {
      at += 2;
    } else {
      if (at + 3 >= size) return false;
      const std::size_t length = std::size_t(bytes[at + 2] << 8 | bytes[at + 3]);
      if (length > size - at - 2) return false;
      if (length < 2) cannot_read_photo(path, "its JPEG data is damaged");
      const std::uint8_t* const segment = bytes + at + 4;
      is_progressive |= marker == kProgressiveFrame;
      if (marker == kHuffmanTables && !tables.define(segment, length - 2))
        cannot_read_photo(path, "its JPEG data has damaged Huffman tables");
      if (marker == kStartOfScan && !tables.suffice_for(segment, length - 2, is_progressive))
        cannot_read_photo(path, "its JPEG data lacks a Huffman table");
      at += 2 + length;
    }
  }
  return false;
}

bool is_png(const std::uint8_t* bytes, std::size_t size) {
  constexpr std::uint8_t kSignature[kPngSignature] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};
  return size >= kPngSignature && std::equal(kSignature, kSignature + kPngSignature, bytes);
}

/// Whether all chunks of a PNG have the length that they promise. stb_image asks for that much memory
/// before it looks. Bytes at the end that are too few for a chunk are passed over.
bool is_whole_png(const std::uint8_t* bytes, std::size_t size) {
  constexpr std::size_t kBeforeData = 8, kBehindData = 4;  // length and type; checksum
  for (std::size_t at = kPngSignature; size - at >= kBeforeData;) {
    const std::size_t length = load_big(bytes + at), left = size - at - kBeforeData;
    if (length > left || left - length < kBehindData) return false;
    at += kBeforeData + length + kBehindData;
  }
  return true;
}

}  // namespace

Image8 decode_photo(const std::filesystem::path& path) {
  check_photo_size(path, decode_photo_size(path));
  ByteReader file(path);
  if (file.size() > INT_MAX) cannot_read_photo(path, "it is larger than 2 GiB");
  const std::size_t size = file.size();
  const std::uint8_t* bytes = file.take(size);
  if (is_jpeg(bytes, size) && !reaches(kEndOfImage, path, bytes, size))
    cannot_read_photo(path, "the JPEG data is cut short");
  if (is_png(bytes, size) && !is_whole_png(bytes, size))
    cannot_read_photo(path, "the PNG data is cut short");

  int width = 0, height = 0, channels = 0;
  const std::unique_ptr<stbi_uc, decltype(&stbi_image_free)> pixels(
      stbi_load_from_memory(bytes, int(size), &width, &height, &channels, 0), stbi_image_free);
  if (!pixels) cannot_read_photo(path, stbi_failure_reason());
  Image8 image(width, height, channels);
  std::copy(pixels.get(), pixels.get() + image.pixels.size(), image.pixels.begin());
  return image;
}

MapFile decode_map(const MapKind& kind, const std::filesystem::path& path) {
  check_photo_size(path, decode_photo_size(path));
  ByteReader file(path);
  if (file.size() > INT_MAX) cannot_read_map(kind, path, "it is larger than 2 GiB");
  const std::size_t size = file.size();
  const std::uint8_t* const bytes = file.take(size);
  if (!is_png(bytes, size))
    cannot_read_map(kind, path,
                    "it is no PNG, and this build has no OpenImageIO for other formats");
  if (!is_whole_png(bytes, size)) cannot_read_map(kind, path, "the PNG data is cut short");
  const bool is_wide = stbi_is_16_bit_from_memory(bytes, int(size)) != 0;
  int width = 0, height = 0, channels = 0;
  const std::unique_ptr<stbi_us, decltype(&stbi_image_free)> pixels(  // bytes v become 257 v
      stbi_load_16_from_memory(bytes, int(size), &width, &height, &channels, 0), stbi_image_free);
  if (!pixels) cannot_read_map(kind, path, stbi_failure_reason());
  static const std::vector<std::string> kNames[] = {
      {"Y"}, {"Y", "A"}, {"R", "G", "B"}, {"R", "G", "B", "A"}};
  const auto [first, count] = kind.channels(kNames[channels - 1]);
  MapFile map{ImageF(width, height, count), true, is_wide ? 16 : 8};
  for (std::size_t i = 0; i < map.values.pixels.size(); ++i) {
    const std::size_t pixel = i / std::size_t(count), channel = i % std::size_t(count);
    map.values.pixels[i] =
        float(pixels.get()[pixel * std::size_t(channels) + std::size_t(first) + channel]) /
        (is_wide ? 1.0f : 257.0f);
  }
  return map;
}

PhotoSize decode_photo_size(const std::filesystem::path& path) {
  PhotoSize size;
  ByteReader file(path);
  const auto read_from = [&](std::uint64_t count) {
    const std::uint8_t* const bytes = file.peek(std::size_t(count));
    int channels = 0;
    return (!is_jpeg(bytes, count) || reaches(kStartOfScan, path, bytes, count)) &&
           stbi_info_from_memory(bytes, int(count), &size.width, &size.height, &channels);
  };
  const auto most = std::min<std::uint64_t>(file.size(), INT_MAX);
  if (!read_from(std::min(most, kHeadBytes)) && !read_from(most))
    cannot_read_photo(path, std::string(stbi_failure_reason()) +
                                " (this build reads JPEG and PNG; OpenImageIO would read more)");
  check_photo_size(path, size);
  return size;
}

int decode_photo_orientation(const std::filesystem::path& path) {
  ByteReader file(path);
  const auto size = std::size_t(std::min<std::uint64_t>(file.size(), kHeadBytes));
  return orientation_of_jpeg({file.peek(size), size});
}

std::optional<Geodetic> decode_photo_place(const std::filesystem::path& path) {
  throw Error("cannot read where the photo " + path.string() +
              " was taken: this build has no OpenImageIO, which reads EXIF; build with it, or give "
              "the places in a file (--gps FILE)");
}

ExposureTags decode_exposure_tags(const std::filesystem::path& path) {
  ByteReader file(path);
  const auto size = std::size_t(std::min<std::uint64_t>(file.size(), kHeadBytes));
  return exposure_tags_of_jpeg({file.peek(size), size});
}

std::vector<std::uint8_t> encode_jpeg_copy(const std::filesystem::path& photo,
                                           const Image8& image) {
  ByteReader file(photo);
  const auto size = std::size_t(std::min<std::uint64_t>(file.size(), kHeadBytes));
  const std::vector<std::uint8_t> exif = upright_exif_of_jpeg({file.peek(size), size});
  constexpr std::size_t kStartOfImage = 2;  // bytes of the marker that comes first
  std::vector<std::uint8_t> bytes = encode_jpeg_alone(image, kCopyQuality);
  bytes.insert(bytes.begin() + kStartOfImage, exif.begin(), exif.end());
  return bytes;
}

std::string codec_name() { return "stb_image"; }

}  // namespace gs
