// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/photos.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <new>

#include "data_loaders/photos/photo_codec.h"
#include "data_loaders/photos/picture_header.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/text/plain_message.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

void check_file(const fs::path& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) cannot_read_photo(path, "there is no such file");
  if (fs::is_directory(status)) cannot_read_photo(path, "this is a folder");
  check_picture(path, read_picture_header(path));
}

/// Calls decode(path) for a file whose header is sound. What a decoder throws gets the file's name.
template <class Decode>
auto with_sound_file(const fs::path& path, Decode&& decode) {
  check_file(path);
  try {
    return decode(path);
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw Error(fmt::format("cannot read photo {}: memory runs out; close other programs, or make "
                            "the photo smaller",
                            path.string()),
                ExitCode::out_of_memory);
  } catch (const std::exception& error) {
    cannot_read_photo(path, plain_message(error));
  }
}

/// The source pixels under target pixel `target` of one axis. In units of 1 / target_size of a
/// source pixel, source pixel i spans [i, i + 1) * target_size and the target pixel [target, target
/// + 1) * source_size: all overlaps are whole numbers, and they add up to source_size.
struct Coverage {
  std::int64_t source_size, target_size, begin, end;

  Coverage(int source_size, int target_size, int target)
      : source_size(source_size), target_size(target_size),
        begin(std::int64_t(target) * source_size), end(begin + source_size) {}
  int first() const { return int(begin / target_size); }
  int last() const { return int((end - 1) / target_size); }
  std::uint32_t weight(int source) const {
    return std::uint32_t(std::min(end, (source + 1) * target_size) -
                         std::max(begin, source * target_size));
  }
};

/// One row of the target: a weighted sum of source rows, then of its columns.
void resize_row(const Image8& image, Image8& target, int y, std::vector<std::uint32_t>& sums) {
  const std::size_t row_size = std::size_t(image.width) * image.channels;
  const Coverage rows(image.height, target.height, y);
  std::fill(sums.begin(), sums.end(), 0u);
  for (int row = rows.first(); row <= rows.last(); ++row) {
    const std::uint32_t weight = rows.weight(row);
    const std::uint8_t* source = &image.pixels[row * row_size];
    for (std::size_t i = 0; i < row_size; ++i) sums[i] += weight * source[i];
  }
  const std::uint64_t area = std::uint64_t(image.width) * image.height;
  for (int x = 0; x < target.width; ++x) {
    const Coverage columns(image.width, target.width, x);
    for (int c = 0; c < image.channels; ++c) {
      std::uint64_t sum = 0;
      for (int column = columns.first(); column <= columns.last(); ++column)
        sum +=
            std::uint64_t(columns.weight(column)) * sums[std::size_t(column) * image.channels + c];
      target.at(x, y, c) = std::uint8_t((2 * sum + area) / (2 * area));
    }
  }
}

}  // namespace

void cannot_read_photo(const fs::path& path, const std::string& what) {
  throw Error(
      fmt::format("cannot read photo {}: {}; copy it again, or leave it out of the COLMAP model",
                  path.string(), what));
}

void cannot_access_photo(const fs::path& path) {
  throw AccessError(fmt::format("cannot read photo {}: {}; check its permissions and the disk",
                                path.string(), std::strerror(errno)));
}

void check_photo_size(const fs::path& path, const PhotoSize& size) {
  if (size.width <= 0 || size.height <= 0 || std::int64_t(size.width) * size.height > kMostPixels)
    cannot_read_photo(path, fmt::format("its header says {} x {} pixels", size.width, size.height));
}

PhotoWithAlpha separated(Image8 decoded) {
  const int channels = decoded.channels, alpha = channels % 2 == 0 ? channels - 1 : 0;
  if (channels == 3) return {std::move(decoded), {}};
  PhotoWithAlpha result;
  result.photo = Image8(decoded.width, decoded.height, 3);
  if (alpha) result.alpha = Image8(decoded.width, decoded.height, 1);
  for (std::size_t i = 0; i < decoded.pixels.size() / channels; ++i) {
    const std::uint8_t* pixel = &decoded.pixels[i * channels];
    for (int c = 0; c < 3; ++c) result.photo.pixels[3 * i + c] = pixel[channels < 3 ? 0 : c];
    if (alpha) result.alpha.pixels[i] = pixel[alpha];
  }
  return result;
}

Image8 joined(const Image8& color, const Image8& fourth) {
  Image8 both(color.width, color.height, 4);
  for (std::size_t i = 0; i < fourth.pixels.size(); ++i) {
    std::copy_n(&color.pixels[3 * i], 3, &both.pixels[4 * i]);
    both.pixels[4 * i + 3] = fourth.pixels[i];
  }
  return both;
}

Image8 read_photo(const fs::path& path) { return read_photo_with_alpha(path).photo; }

PhotoWithAlpha read_photo_with_alpha(const fs::path& path) {
  return with_sound_file(path, [](const fs::path& file) { return separated(decode_photo(file)); });
}

PhotoSize read_photo_size(const fs::path& path) { return with_sound_file(path, decode_photo_size); }

int read_photo_orientation(const fs::path& path) {
  const int orientation = with_sound_file(path, decode_photo_orientation);
  return orientation >= 1 && orientation <= 8 ? orientation : 1;
}

std::optional<Geodetic> read_photo_place(const fs::path& path) {
  const std::optional<Geodetic> place = with_sound_file(path, decode_photo_place);
  return place && is_on_earth(*place) ? place : std::nullopt;
}

std::optional<float> read_exposure_stops(const fs::path& path) {
  const ExposureTags tags = with_sound_file(path, decode_exposure_tags);
  const double light = tags.seconds * tags.iso / (tags.f_number * tags.f_number);
  if (!(tags.seconds > 0 && tags.iso > 0 && tags.f_number > 0) || !std::isfinite(light)) return {};
  return float(std::log2(light));
}

Image8 area_resized(const Image8& image, int width, int height) {
  GS_CHECK(width > 0 && height > 0 && !image.empty());
  if (width == image.width && height == image.height) return image;
  Image8 target(width, height, image.channels);
  constexpr std::size_t kRowsPerChunk = 16;
  parallel_chunks(std::size_t(height), kRowsPerChunk, [&](std::size_t begin, std::size_t end) {
    std::vector<std::uint32_t> sums(std::size_t(image.width) * image.channels);
    for (std::size_t y = begin; y < end; ++y) resize_row(image, target, int(y), sums);
  });
  return target;
}

std::string note_on_reduced_photos(const PhotoSize& largest, const PhotoSize& reduced) {
  return fmt::format("photos of {}x{} are trained at {}x{}; -r 1 keeps all of their pixels",
                     largest.width, largest.height, reduced.width, reduced.height);
}

}  // namespace gs
