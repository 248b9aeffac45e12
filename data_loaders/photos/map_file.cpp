// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/map_file.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>
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

/// Whether a channel has this name, in any layer.
bool is_channel(const std::string& name, const std::string& wanted) {
  return name == wanted || name.ends_with("." + wanted);
}

std::pair<int, int> depth_channel(const std::vector<std::string>& names) {
  const int count = int(names.size());
  if (count == 1) return {0, 1};
  for (const char* const wanted : {"Z", "depth", "Depth", "Y"})
    for (int c = 0; c < count; ++c)
      if (is_channel(names[std::size_t(c)], wanted)) return {c, 1};
  return {0, std::min(count, 3)};
}

std::pair<int, int> normal_channels(const std::vector<std::string>& names) {
  const auto has_xyz = [&](std::size_t c, const char* layer) {
    return is_channel(names[c], "X") && is_channel(names[c + 1], "Y") &&
           is_channel(names[c + 2], "Z") &&
           (!*layer || is_channel(names[c].substr(0, names[c].rfind('.')), layer));
  };
  for (const char* const layer : {"Normal", "N", ""})
    for (std::size_t c = 0; c + 2 < names.size(); ++c)
      if (has_xyz(c, layer)) return {int(c), 3};
  const int count = int(names.size());
  return {0, count > 3 && is_channel(names[3], "A") ? 4 : std::min(count, 3)};
}

/// What an error of a photo's decoder says is wrong, without its name for the file and its remedy.
std::string what_is_wrong(const Error& error, const fs::path& path) {
  std::string text = error.what();
  const std::string before = fmt::format("cannot read photo {}: ", path.string());
  if (!text.starts_with(before)) return text;
  text.erase(0, before.size());
  return text.substr(0, text.rfind("; "));
}

/// Calls decode() for a file whose header is sound. Whatever fails is said of a map.
template <class Decode>
auto with_sound_map(const MapKind& kind, const fs::path& path, Decode&& decode) {
  try {
    check_picture(path, read_picture_header(path));
    return decode();
  } catch (const AccessError&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw Error(fmt::format("cannot read {} {}: memory runs out; close other programs, or make the "
                            "map smaller",
                            kind.noun, path.string()),
                ExitCode::out_of_memory);
  } catch (const Error& error) {
    if (std::string(error.what()).starts_with(fmt::format("cannot read {}", kind.noun))) throw;
    cannot_read_map(kind, path, what_is_wrong(error, path));
  } catch (const std::exception& error) {
    cannot_read_map(kind, path, plain_message(error));
  }
}

/// The first channel of gray values. Throws Error where the channels of a pixel differ.
void take_gray(const fs::path& path, ImageF& values) {
  const int channels = values.channels;
  ImageF gray(values.width, values.height, 1);
  for (std::size_t i = 0; i < gray.pixels.size(); ++i) {
    const float* const pixel = &values.pixels[i * std::size_t(channels)];
    for (int c = 1; c < channels; ++c)
      if (pixel[c] != pixel[0] && pixel[c] == pixel[c])
        cannot_read_map(kDepthMap, path, "it is a picture in colors, whose values are no depths");
    gray.pixels[i] = pixel[0];
  }
  values = std::move(gray);
}

/// The normal of a pixel; 0 where the file says nothing.
Vec3f normal_of(const MapFile& file, const float* pixel) {
  constexpr float kShortest = 0.5f, kLongest = 1.5f;
  if (file.values.channels > 3 && !(pixel[3] > 0)) return Vec3f(0);
  Vec3f n{pixel[0], pixel[1], pixel[2]};
  if (file.has_steps) n = n * (2 / float((1 << file.bits) - 1)) - Vec3f(1);
  const float length = std::sqrt(inner(n, n));
  return length >= kShortest && length <= kLongest ? n / length : Vec3f(0);
}

}  // namespace

const MapKind kDepthMap{"depth map",
                        "write it again as a gray PNG of 16 bits or an EXR, take it out of the "
                        "folder, or train without "
                        "maps (--set dataset.depth=none)",
                        depth_channel};
const MapKind kNormalMap{
    "normal map",
    "write it again as a PNG in colors or an EXR of three channels, take it out of the folder, or "
    "train without maps (--set surface.prior_weight=0)",
    normal_channels};

void cannot_read_map(const MapKind& kind, const fs::path& path, const std::string& what) {
  throw Error(
      fmt::format("cannot read {} {}: {}; {}", kind.noun, path.string(), what, kind.remedy));
}

MapFile read_depth_file(const fs::path& path) {
  return with_sound_map(kDepthMap, path, [&] {
    MapFile file = decode_map(kDepthMap, path);
    take_gray(path, file.values);
    return file;
  });
}

ImageF read_normal_file(const fs::path& path) {
  return with_sound_map(kNormalMap, path, [&] {
    const MapFile file = decode_map(kNormalMap, path);
    const ImageF& values = file.values;
    const auto channels = std::size_t(values.channels);
    if (channels < 3)
      cannot_read_map(kNormalMap, path, "it is gray, and normals have three numbers");
    ImageF normals(values.width, values.height, 3);
    parallel_for(normals.pixels.size() / 3, 4096, [&](std::size_t i) {
      const Vec3f n = normal_of(file, &values.pixels[i * channels]);
      for (int c = 0; c < 3; ++c) normals.pixels[3 * i + std::size_t(c)] = n[c];
    });
    return normals;
  });
}

PhotoSize read_map_size(const MapKind& kind, const fs::path& path) {
  return with_sound_map(kind, path, [&] { return decode_photo_size(path); });
}

}  // namespace gs
