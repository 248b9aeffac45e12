// SPDX-License-Identifier: Apache-2.0
// Small photos through the whole way from a file to pixels: our check of the header, OpenImageIO (or
// stb_image) under the ending that the first byte chooses, EXIF tags, alpha, and upright pixels.
// The decoders are not instrumented: what is tested is that they are called with bounds, and that
// what they throw or return is checked.
#include "data_loaders/photos/photos.h"

#include <array>
#include <cmath>

#include "data_loaders/photos/map_file.h"
#include "data_loaders/photos/orientation.h"
#include "data_loaders/photos/picture_header.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/foreign_leaks.h"

namespace gs::fuzz {
namespace {

constexpr std::uint64_t kMostDecoded = 1 << 16;  // pixels
constexpr std::array<const char*, 8> kEndings = {"jpg",  "png", "tif", "bmp",
                                                 "webp", "exr", "hdr", "tga"};

/// Larger pictures, which any decoder takes its time for, are checked and not decoded.
bool is_small(const std::filesystem::path& file) {
  const PictureHeader header = read_picture_header(file);
  check_picture(file, header);
  return header.width == 0 ||
         (header.width <= kMostDecoded && header.height <= kMostDecoded / header.width);
}

void decode(const std::filesystem::path& file) {
  const IgnoreForeignLeaks image_library;
  const PhotoSize size = read_photo_size(file);
  if (std::uint64_t(size.width) * std::uint64_t(size.height) > kMostDecoded) return;
  takes([&] {
    const int orientation = read_photo_orientation(file);
    const PhotoSize turned = upright_size(size, orientation);
    const Image8 picture = read_upright(file);
    require(picture.width == turned.width && picture.height == turned.height,
            "an upright photo has another size than its header says");
  });
  takes([&] {
    const auto place = read_photo_place(file);
    require(!place || (std::isfinite(place->longitude) && std::isfinite(place->latitude) &&
                       std::isfinite(place->height)),
            "a photo was taken nowhere");
  });
  takes([&] {
    const auto stops = read_exposure_stops(file);
    require(!stops || std::isfinite(*stops), "a photo was exposed endlessly");
  });
  takes([&] {
    const PhotoWithAlpha photo = read_photo_with_alpha(file);
    require(photo.photo.width == size.width && photo.photo.height == size.height &&
                photo.photo.channels == 3,
            "a photo has another size than its header says");
    require(photo.alpha.pixels.empty() || photo.alpha.width == size.width,
            "an alpha has another size than its photo");
  });
  takes([&] {
    const MapFile depth = read_depth_file(file);
    require(depth.values.width == size.width && depth.values.height == size.height,
            "a depth map has another size than its header says");
  });
  takes([&] {
    const ImageF normals = read_normal_file(file);
    require(normals.width == size.width && normals.height == size.height,
            "a normal map has another size than its header says");
  });
}

void read(std::string_view bytes) {
  if (bytes.empty()) return;
  const std::string ending = kEndings[std::size_t(std::uint8_t(bytes[0])) % kEndings.size()];
  const std::filesystem::path file = file_of("photo." + ending, bytes.substr(1));
  takes([&] {
    if (is_small(file)) decode(file);
  });
}

const Registered registered{"photos", read};

}  // namespace
}  // namespace gs::fuzz
