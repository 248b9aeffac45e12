// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/view_picture.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "data_loaders/lenses/hemispheres.h"
#include "data_loaders/lenses/lens_range.h"
#include "data_loaders/lenses/undistort.h"
#include "data_loaders/video/film_frames.h"
#include "gs_core/error.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// Pixels: bicubic weights of the mask reach 2 beyond its edge, those of the photo 2 more.
constexpr int kReach = 4;

/// One of the halves of a panorama and its mask.
void cut_hemisphere(Picture& picture, const Photo& photo) {
  auto& [pixels, mask] = picture;
  const auto cut = [&](const Image8& panorama) {
    return hemisphere_of(panorama, photo.lens, photo.is_back, photo.name);
  };
  if (mask.empty()) {
    pixels = cut(evened_panorama(pixels));
    return;
  }
  multiply_by_mask(pixels, mask);
  mask = evened_panorama(mask);
  pixels = evened_panorama(pixels);
  divide_by_mask(pixels, mask);
  fill_masked_edge(pixels, mask, kReach);
  pixels = cut(pixels);
  mask = cut(mask);
}

/// Photo and mask as the view's camera sees them. No color from under the mask leaks out of it.
void fit_to_camera(Picture& picture, const Photo& photo) {
  auto& [pixels, mask] = picture;
  const bool is_masked = !mask.empty();
  const std::string& name = photo.name;
  if (photo.is_undistorted()) {
    if (is_masked) fill_masked_edge(pixels, mask, kReach);
    pixels = undistorted_photo(pixels, photo.lens, photo.undistorted, name);
    if (is_masked) mask = undistorted_photo(mask, photo.lens, photo.undistorted, name);
  }
  if (!photo.is_resized()) return;
  const int width = photo.target.width, height = photo.target.height;
  if (is_masked) {
    multiply_by_mask(pixels, mask);
    mask = area_resized(mask, width, height);
  }
  pixels = area_resized(pixels, width, height);
  if (is_masked) divide_by_mask(pixels, mask);
}

}  // namespace

Image8 read_mask_file(const fs::path& file) {
  PhotoWithAlpha read = read_photo_with_alpha(file);
  const auto is_below_full = [](std::uint8_t value) { return value < 255; };
  if (std::any_of(read.alpha.pixels.begin(), read.alpha.pixels.end(), is_below_full))
    return std::move(read.alpha);
  Image8 mask(read.photo.width, read.photo.height, 1);
  for (std::size_t i = 0; i < mask.pixels.size(); ++i) {
    const std::uint8_t* pixel = &read.photo.pixels[3 * i];
    mask.pixels[i] = std::max({pixel[0], pixel[1], pixel[2]});
  }
  const std::uint8_t highest = *std::max_element(mask.pixels.begin(), mask.pixels.end());
  if (highest == 1)
    for (std::uint8_t& value : mask.pixels) value = std::uint8_t(255 * value);
  return mask;
}

void leave_out(const Image8& kept, Image8& mask) {
  if (mask.empty()) mask = kept;
  for (std::size_t i = 0; i < mask.pixels.size(); ++i)
    mask.pixels[i] = std::min(mask.pixels[i], kept.pixels[i]);
}

Picture make_picture(const Photo& photo) {
  if (photo.is_frame) return make_picture(photo, {read_frame(photo.file, photo.frame), {}});
  return make_picture(photo, read_photo_with_alpha(photo.file));
}

Picture make_picture(const Photo& photo, PhotoWithAlpha read) {
  if (read.photo.width != photo.size.width || read.photo.height != photo.size.height)
    throw Error(
        fmt::format("{} has changed since the scene was loaded; start again", photo.file.string()));
  Picture picture{{}, read_mask(photo.masks, photo.mask_file, read)};
  picture.photo = std::move(read.photo);
  if (photo.lens.is_hemisphere()) cut_hemisphere(picture, photo);
  if (!photo.is_explained)
    leave_out(mask_of_lens(photo.lens, photo.undistorted.lens), picture.mask);
  fit_to_camera(picture, photo);
  return picture;
}

Image8 read_mask(const MaskUse& use, const fs::path& file, const PhotoWithAlpha& photo) {
  Image8 mask;
  if (!file.empty()) {
    mask = read_mask_file(file);
    if (use.invert)
      for (std::uint8_t& value : mask.pixels) value = std::uint8_t(255 - value);
    mask = area_resized(mask, photo.photo.width, photo.photo.height);
  } else if (use.use_alpha) {
    mask = photo.alpha;
  }
  const bool is_full = std::all_of(mask.pixels.begin(), mask.pixels.end(),
                                   [](std::uint8_t value) { return value == 255; });
  return is_full ? Image8() : mask;
}

void fill_masked_edge(Image8& photo, const Image8& mask, int reach) {
  GS_CHECK(photo.pixels.size() == 3 * mask.pixels.size() && reach < 255);
  std::vector<std::uint8_t> filled_in(mask.pixels.size());  // the round, from 1; 0: not yet
  for (std::size_t i = 0; i < filled_in.size(); ++i) filled_in[i] = mask.pixels[i] > 0;
  const auto fill = [&](int x, int y, int round) {
    int sums[3] = {0, 0, 0}, count = 0;
    for (int v = std::max(y - 1, 0); v <= std::min(y + 1, photo.height - 1); ++v)
      for (int u = std::max(x - 1, 0); u <= std::min(x + 1, photo.width - 1); ++u) {
        const int known = filled_in[std::size_t(v) * photo.width + u];
        if (known == 0 || known > round) continue;
        for (int c = 0; c < 3; ++c) sums[c] += photo.at(u, v, c);
        ++count;
      }
    if (count == 0) return;
    for (int c = 0; c < 3; ++c) photo.at(x, y, c) = std::uint8_t((sums[c] + count / 2) / count);
    filled_in[std::size_t(y) * photo.width + x] = std::uint8_t(round + 1);
  };
  for (int round = 1; round <= reach; ++round)
    for (int y = 0; y < photo.height; ++y)
      for (int x = 0; x < photo.width; ++x)
        if (filled_in[std::size_t(y) * photo.width + x] == 0) fill(x, y, round);
}

void multiply_by_mask(Image8& photo, const Image8& mask) {
  GS_CHECK(photo.pixels.size() == 3 * mask.pixels.size());
  for (std::size_t i = 0; i < photo.pixels.size(); ++i)
    photo.pixels[i] = std::uint8_t((photo.pixels[i] * mask.pixels[i / 3] + 127) / 255);
}

void divide_by_mask(Image8& photo, const Image8& mask) {
  GS_CHECK(photo.pixels.size() == 3 * mask.pixels.size());
  for (std::size_t i = 0; i < photo.pixels.size(); ++i) {
    const int m = mask.pixels[i / 3];
    if (m > 0)
      photo.pixels[i] = std::uint8_t(std::min((255 * photo.pixels[i] + m / 2) / m, 255));
    else
      photo.pixels[i] = 0;
  }
}

double trained_share(const Image8& mask) {
  if (mask.empty()) return 1;
  double sum = 0;
  for (const std::uint8_t value : mask.pixels) sum += value;
  return sum / (255.0 * double(mask.pixels.size()));
}

}  // namespace gs
