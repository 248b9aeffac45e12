// SPDX-License-Identifier: Apache-2.0
// JPEGs by stb_image_write, for machines that have neither OpenImageIO nor libjpeg.
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STB_IMAGE_WRITE_STATIC
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"  // of a single-header library
#include <stb_image_write.h>
#pragma GCC diagnostic pop

#include "data_loaders/photos/encode/encode_jpeg.h"
#include "gs_core/error.h"

namespace gs {
namespace {

// Adds `size` bytes at the end of a std::vector<std::uint8_t>.
void append_bytes(void* vector, void* data, int size) {
  auto& bytes = *static_cast<std::vector<std::uint8_t>*>(vector);
  const auto* const first = static_cast<const std::uint8_t*>(data);
  bytes.insert(bytes.end(), first, first + size);
}

}  // namespace

std::vector<std::uint8_t> encode_jpeg_alone(const Image8& image, int quality) {
  GS_CHECK(image.channels == 3);
  std::vector<std::uint8_t> bytes;
  if (!stbi_write_jpg_to_func(append_bytes, &bytes, image.width, image.height, 3,
                              image.pixels.data(), quality))
    throw Error("cannot encode a JPEG: out of memory; write fewer or smaller pictures",
                ExitCode::out_of_memory);
  return bytes;
}

}  // namespace gs
