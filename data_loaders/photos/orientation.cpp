// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/orientation.h"

#include <algorithm>

#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/photo_codec.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_core/system/files/atomic_file.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

struct Pixel {
  int x, y;
};

bool swaps_sides(int orientation) { return orientation >= 5 && orientation <= 8; }

/// The stored pixel that is seen at (x, y) of the upright picture; width and height are as stored.
Pixel stored_pixel(int orientation, int x, int y, int width, int height) {
  const int right = width - 1, bottom = height - 1;
  switch (orientation) {
    case 2: return {right - x, y};           // mirrored
    case 3: return {right - x, bottom - y};  // upside down
    case 4: return {x, bottom - y};
    case 5: return {y, x};
    case 6: return {y, bottom - x};  // of a phone that is held upright
    case 7: return {right - y, bottom - x};
    case 8: return {right - y, x};
    default: return {x, y};
  }
}

/// The orientation of a picture that is upright once it is turned by so many degrees.
int orientation_of_turn(int degrees) {
  return degrees == 90 ? 6 : degrees == 180 ? 3 : degrees == 270 ? 8 : 1;
}

/// Color with its alpha as a fourth channel, if there is one.
Image8 with_alpha(PhotoWithAlpha read) {
  return read.alpha.empty() ? std::move(read.photo) : joined(read.photo, read.alpha);
}

}  // namespace

PhotoSize upright_size(const PhotoSize& stored, int orientation) {
  return swaps_sides(orientation) ? PhotoSize{stored.height, stored.width} : stored;
}

Image8 upright(const Image8& stored, int orientation) {
  const auto [width, height] = upright_size({stored.width, stored.height}, orientation);
  Image8 image(width, height, stored.channels);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const Pixel from = stored_pixel(orientation, x, y, stored.width, stored.height);
      for (int c = 0; c < stored.channels; ++c) image.at(x, y, c) = stored.at(from.x, from.y, c);
    }
  return image;
}

Image8 as_stored(const Image8& picture, int orientation) {
  const int inverse = orientation == 6 ? 8 : orientation == 8 ? 6 : orientation;
  return upright(picture, inverse);
}

PhotoSize turned_size(const PhotoSize& size, int degrees) {
  return upright_size(size, orientation_of_turn(degrees));
}

Image8 turned(const Image8& image, int degrees) {
  return upright(image, orientation_of_turn(degrees));
}

Image8 read_upright(const fs::path& photo) {
  return upright(with_alpha(read_photo_with_alpha(photo)), read_photo_orientation(photo));
}

void write_copy(const fs::path& photo, const Image8& upright, const fs::path& copy) {
  const std::string ending = lowercase_ending(copy);
  if (ending != ".jpg" && ending != ".jpeg") return write_png(copy, upright);
  const std::vector<std::uint8_t> bytes =
      encode_jpeg_copy(photo, upright.channels == 4 ? separated(upright).photo : upright);
  AtomicFile file(copy);
  file.write(bytes.data(), bytes.size());
  file.commit();
}

}  // namespace gs
