// SPDX-License-Identifier: Apache-2.0
#include "gs_app/pictures/pictures.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "data_loaders/photos/photo_names.h"

namespace gs {

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
  return folder / (without_extension(name.generic_string()) + ".png");
}

}  // namespace gs
