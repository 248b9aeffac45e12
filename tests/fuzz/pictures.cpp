// SPDX-License-Identifier: Apache-2.0
// Headers of pictures, which are ours to read: JPEG, PNG, GIF, TIFF, BMP, WebP, JPEG 2000, HEIF.
// OpenImageIO is not the target, so only small JPEG and PNG are decoded, and their size is compared.
#include "data_loaders/photos/picture_header.h"

#include "data_loaders/photos/map_file.h"
#include "data_loaders/photos/photos.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/foreign_leaks.h"

namespace gs::fuzz {
namespace {

constexpr std::uint64_t kMostDecoded = 1 << 16;  // pixels

void decode(const std::filesystem::path& file, const PictureHeader& header) {
  const IgnoreForeignLeaks image_library;
  const PhotoSize size = read_photo_size(file);
  require(std::uint64_t(size.width) <= header.width && std::uint64_t(size.height) <= header.height,
          "a picture is larger than its header says");
  const PhotoWithAlpha photo = read_photo_with_alpha(file);
  require(photo.photo.width == size.width && photo.photo.height == size.height,
          "a photo has another size than its header");
  takes([&] {  // most pictures are no depth maps
    const MapFile depth = read_depth_file(file);
    require(depth.values.width == size.width && depth.values.height == size.height,
            "a depth map has another size than its header");
  });
  takes([&] {
    const ImageF normals = read_normal_file(file);
    require(normals.width == size.width && normals.height == size.height,
            "a normal map has another size than its header");
  });
}

void read(std::string_view bytes) {
  const bool is_jpeg = bytes.starts_with("\xFF\xD8\xFF"), is_png = bytes.starts_with("\x89PNG");
  const std::filesystem::path file = file_of(is_png ? "a.png" : "a.jpg", bytes);
  takes([&] {
    const PictureHeader header = read_picture_header(file);
    check_picture(file, header);
    if ((is_jpeg || is_png) && header.width > 0 && header.height > 0 &&
        header.width <= kMostDecoded && header.height <= kMostDecoded / header.width)
      decode(file, header);
  });
}

const Registered registered{"pictures", read};

}  // namespace
}  // namespace gs::fuzz
