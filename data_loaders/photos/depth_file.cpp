// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/photos/depth_file.h"

#include <spdlog/fmt/fmt.h>

#include <new>

#include "data_loaders/photos/photo_codec.h"
#include "data_loaders/photos/picture_header.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/text/plain_message.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// What an error of a photo's decoder says is wrong, without its name for the file and its remedy.
std::string what_is_wrong(const Error& error, const fs::path& path) {
  std::string text = error.what();
  const std::string before = fmt::format("cannot read photo {}: ", path.string());
  if (!text.starts_with(before)) return text;
  text.erase(0, before.size());
  return text.substr(0, text.rfind("; "));
}

/// Calls decode(path) for a file whose header is sound. Whatever fails is said of a depth map.
template <class Decode>
auto with_sound_map(const fs::path& path, Decode&& decode) {
  try {
    check_picture(path, read_picture_header(path));
    return decode(path);
  } catch (const AccessError&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw Error(fmt::format("cannot read depth map {}: memory runs out; close other programs, or "
                            "make the map smaller",
                            path.string()),
                ExitCode::out_of_memory);
  } catch (const Error& error) {
    if (std::string(error.what()).starts_with("cannot read depth map")) throw;
    cannot_read_depth(path, what_is_wrong(error, path));
  } catch (const std::exception& error) {
    cannot_read_depth(path, plain_message(error));
  }
}

}  // namespace

void cannot_read_depth(const fs::path& path, const std::string& what) {
  throw Error(
      fmt::format("cannot read depth map {}: {}; write it again as a gray PNG of 16 bits or an "
                  "EXR, take it out "
                  "of the folder, or train without maps (--set dataset.depth=none)",
                  path.string(), what));
}

void take_gray(const fs::path& path, const std::vector<float>& values, int channels,
               ImageF& depth) {
  GS_CHECK(values.size() == depth.pixels.size() * std::size_t(channels));
  for (std::size_t i = 0; i < depth.pixels.size(); ++i) {
    const float* const pixel = &values[i * std::size_t(channels)];
    for (int c = 1; c < channels; ++c)
      if (pixel[c] != pixel[0] && pixel[c] == pixel[c])
        cannot_read_depth(path, "it is a picture in colors, whose values are no depths");
    depth.pixels[i] = pixel[0];
  }
}

DepthFile read_depth_file(const fs::path& path) {
  return with_sound_map(path, [](const fs::path& file) { return decode_depth(file); });
}

PhotoSize read_depth_size(const fs::path& path) {
  return with_sound_map(path, [](const fs::path& file) { return decode_photo_size(file); });
}

}  // namespace gs
