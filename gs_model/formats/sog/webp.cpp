// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/sog/webp.h"

#include <spdlog/fmt/fmt.h>

#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/text/foreign_text.h"

#ifdef GS_HAVE_WEBP
#include <webp/decode.h>
#include <webp/encode.h>
#endif

namespace gs {

#ifdef GS_HAVE_WEBP

namespace {

constexpr int kLevel = 6;  // of 0..9: beyond it, pictures get slower to write and hardly smaller

}  // namespace

void require_webp() {}

std::string webp_of(const Image8& rgba) {
  GS_CHECK(rgba.channels == 4);
  WebPConfig config;
  WebPPicture picture;
  GS_CHECK(WebPConfigInit(&config) && WebPPictureInit(&picture) &&
           WebPConfigLosslessPreset(&config, kLevel));
  config.exact = 1;
  picture.use_argb = 1;
  picture.width = rgba.width;
  picture.height = rgba.height;
  WebPMemoryWriter writer;
  WebPMemoryWriterInit(&writer);
  picture.writer = WebPMemoryWrite;
  picture.custom_ptr = &writer;
  const bool is_done = WebPPictureImportRGBA(&picture, rgba.pixels.data(), 4 * rgba.width) &&
                       WebPEncode(&config, &picture);
  const std::string bytes(reinterpret_cast<const char*>(writer.mem), is_done ? writer.size : 0);
  const int error = picture.error_code;
  WebPPictureFree(&picture);
  WebPMemoryWriterClear(&writer);
  if (!is_done)
    throw Error(
        fmt::format("libwebp cannot write a picture of {}x{} pixels (error {}); choose "
                    "another format than .sog",
                    rgba.width, rgba.height, error));
  return bytes;
}

Image8 read_webp(const std::filesystem::path& path, const std::string& entry,
                 std::string_view bytes, std::size_t most_pixels) {
  const auto* data = reinterpret_cast<const std::uint8_t*>(bytes.data());
  int width = 0, height = 0;
  const bool is_webp = WebPGetInfo(data, bytes.size(), &width, &height);
  if (!is_webp || width <= 0 || height <= 0 || std::size_t(width) * height > most_pixels)
    cannot_read(path, fmt::format("{} in it is not a WebP picture of the right size; the file is "
                                  "damaged, export it again",
                                  shown_word(entry)));
  Image8 picture(width, height, 4);
  if (!WebPDecodeRGBAInto(data, bytes.size(), picture.pixels.data(), picture.pixels.size(),
                          4 * width))
    cannot_read(path,
                fmt::format("the picture {} in it is damaged; export it again", shown_word(entry)));
  return picture;
}

#else

void require_webp() {
  throw Error(
      "this build has no libwebp, which .sog needs; install libwebp-dev, run `cmake --fresh "
      "--preset default` and build again, or choose another format");
}
std::string webp_of(const Image8&) {
  require_webp();
  return {};
}
Image8 read_webp(const std::filesystem::path&, const std::string&, std::string_view, std::size_t) {
  require_webp();
  return {};
}

#endif

}  // namespace gs
