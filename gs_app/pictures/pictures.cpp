// SPDX-License-Identifier: Apache-2.0
#include "gs_app/pictures/pictures.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <iterator>
#include <string_view>

#include "data_loaders/photos/photo_names.h"

namespace gs {
namespace {

constexpr std::string_view kPhotoExtensions[] = {".jpg",  ".jpeg", ".png",  ".tif",
                                                 ".tiff", ".bmp",  ".webp", ".exr"};

}  // namespace

std::vector<std::size_t> evenly_chosen(std::size_t count, std::size_t wanted) {
  const std::size_t chosen = std::min(count, wanted);
  std::vector<std::size_t> indices(chosen);
  for (std::size_t i = 0; i < chosen; ++i) indices[i] = (2 * i + 1) * count / (2 * chosen);
  return indices;
}

std::string picture_file(std::size_t index) { return fmt::format("{:05d}.png", index); }

std::filesystem::path picture_path(const std::filesystem::path& folder,
                                   const std::string& view_name) {
  std::filesystem::path name = std::filesystem::path(view_name).lexically_normal();
  if (name.is_absolute() || (!name.empty() && *name.begin() == "..")) name = name.filename();
  const std::string extension = lowercase_ending(name);
  // cameras.json has names without extension: the ".7" of "frame.7" is none.
  if (std::find(std::begin(kPhotoExtensions), std::end(kPhotoExtensions), extension) !=
      std::end(kPhotoExtensions))
    name.replace_extension();
  return folder / (name += ".png");
}

}  // namespace gs
