// SPDX-License-Identifier: Apache-2.0
// Photos and EXR pictures, by way of gemsplat_photos.so; modules.h says why.
#include "apps/cli/lazy/modules.h"
#include "data_loaders/photos/encode/encode_jpeg.h"
#include "data_loaders/photos/exr.h"

namespace gs {
namespace {

const PhotoModule& module() {
  static const PhotoModule& table =
      loaded_module<PhotoModule>("gemsplat_photos.so", "gs_photo_module");
  return table;
}

}  // namespace

Image8 decode_photo(const std::filesystem::path& path) { return module().decode_photo(path); }
MapFile decode_map(const MapKind& kind, const std::filesystem::path& path) {
  return module().decode_map(kind, path);
}
PhotoSize decode_photo_size(const std::filesystem::path& path) {
  return module().decode_photo_size(path);
}
int decode_photo_orientation(const std::filesystem::path& path) {
  return module().decode_photo_orientation(path);
}
std::optional<Geodetic> decode_photo_place(const std::filesystem::path& path) {
  return module().decode_photo_place(path);
}
ExposureTags decode_exposure_tags(const std::filesystem::path& path) {
  return module().decode_exposure_tags(path);
}
std::string codec_name() { return module().codec_name(); }
std::vector<std::uint8_t> encode_jpeg_alone(const Image8& image, int quality) {
  return module().encode_jpeg_alone(image, quality);
}
std::vector<std::uint8_t> encode_jpeg_copy(const std::filesystem::path& photo,
                                           const Image8& image) {
  return module().encode_jpeg_copy(photo, image);
}

bool can_write_exr() { return true; }
std::string cannot_write_exr() { return {}; }
void write_exr(const std::filesystem::path& path, const ImageF& image,
               const std::vector<std::string>& channels) {
  module().write_exr(path, image, channels);
}
ImageF read_exr(const std::filesystem::path& path, std::vector<std::string>* channels) {
  return module().read_exr(path, channels);
}

}  // namespace gs
