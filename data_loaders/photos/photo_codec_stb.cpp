// SPDX-License-Identifier: Apache-2.0
// Photos through stb_image, for machines without OpenImageIO: JPEG and PNG.
#define STB_IMAGE_IMPLEMENTATION
#define STB_IMAGE_STATIC
#define STBI_ONLY_JPEG
#define STBI_ONLY_PNG
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STB_IMAGE_WRITE_STATIC
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"  // of a single-header library
#include <stb_image.h>
#include <stb_image_write.h>
#pragma GCC diagnostic pop

#include <climits>
#include <memory>

#include "data_loaders/photos/photo_codec.h"
#include "gs_core/error.h"
#include "gs_core/io/byte_reader.h"

namespace gs {
namespace {

constexpr std::uint8_t kEndOfImage = 0xD9;

/// Whether a JPEG file reaches its end marker. stb_image fills what is missing with gray and says
/// nothing. Walks the segments; in the entropy-coded data behind a start of scan, FF is always
/// followed by 00 or a restart marker (ITU-T T.81, B.1.1).
bool reaches_its_end(const std::uint8_t* bytes, std::size_t size) {
  std::size_t at = 2;  // behind the start-of-image marker
  while (at + 1 < size) {
    if (bytes[at] != 0xFF) {
      ++at;  // entropy-coded data
      continue;
    }
    const std::uint8_t marker = bytes[at + 1];
    const bool stands_alone = marker == 0x00 || (marker >= 0xD0 && marker <= 0xD8);
    if (marker == kEndOfImage) return true;
    if (marker == 0xFF) {
      ++at;  // a fill byte
    } else if (stands_alone) {
      at += 2;
    } else {
      if (at + 3 >= size) return false;
      at += 2 + std::size_t(bytes[at + 2] << 8 | bytes[at + 3]);  // the segment's length
    }
  }
  return false;
}

void append(void* context, void* data, int size) {
  auto* bytes = static_cast<std::vector<std::uint8_t>*>(context);
  const auto* begin = static_cast<const std::uint8_t*>(data);
  bytes->insert(bytes->end(), begin, begin + size);
}

}  // namespace

Image8 decode_photo(const std::filesystem::path& path) {
  check_photo_size(path, decode_photo_size(path));
  ByteReader file(path);
  if (file.size() > INT_MAX) cannot_read_photo(path, "it is larger than 2 GiB");
  const std::size_t size = file.size();
  const std::uint8_t* bytes = file.take(size);
  if (bytes[0] == 0xFF && bytes[1] == 0xD8 && !reaches_its_end(bytes, size))
    cannot_read_photo(path, "the JPEG data is cut short");

  int width = 0, height = 0, channels = 0;
  const std::unique_ptr<stbi_uc, decltype(&stbi_image_free)> pixels(
      stbi_load_from_memory(bytes, int(size), &width, &height, &channels, 0), stbi_image_free);
  if (!pixels) cannot_read_photo(path, stbi_failure_reason());
  Image8 image(width, height, channels);
  std::copy(pixels.get(), pixels.get() + image.pixels.size(), image.pixels.begin());
  return image;
}

PhotoSize decode_photo_size(const std::filesystem::path& path) {
  PhotoSize size;
  int channels = 0;
  if (!stbi_info(path.c_str(), &size.width, &size.height, &channels))
    cannot_read_photo(path, std::string(stbi_failure_reason()) +
                                " (this build reads JPEG and PNG; OpenImageIO would read more)");
  check_photo_size(path, size);
  return size;
}

int decode_photo_orientation(const std::filesystem::path&) { return 1; }  // stb_image reads no EXIF

std::string codec_name() { return "stb_image"; }

std::vector<std::uint8_t> encode_png(const Image8& image) {
  std::vector<std::uint8_t> bytes;
  const int stride = image.width * image.channels;
  if (!stbi_write_png_to_func(append, &bytes, image.width, image.height, image.channels,
                              image.pixels.data(), stride))
    throw Error("cannot encode a PNG: out of memory; write fewer or smaller pictures",
                ExitCode::out_of_memory);
  return bytes;
}

std::vector<std::uint8_t> encode_jpeg(const Image8& image, int quality) {
  GS_CHECK(image.channels == 3);
  std::vector<std::uint8_t> bytes;
  if (!stbi_write_jpg_to_func(append, &bytes, image.width, image.height, 3, image.pixels.data(),
                              quality))
    throw Error("cannot encode a JPEG: out of memory; write fewer or smaller pictures",
                ExitCode::out_of_memory);
  return bytes;
}

}  // namespace gs
