// SPDX-License-Identifier: Apache-2.0
#include "gs_app/pictures/pictures.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "data_loaders/photos/photo_names.h"

namespace gs {

std::string picture_file(std::size_t index) { return fmt::format("{:05d}.png", index); }

std::filesystem::path picture_path(const std::filesystem::path& folder,
                                   const std::string& view_name) {
  std::filesystem::path name = std::filesystem::path(view_name).lexically_normal();
  if (name.is_absolute() || (!name.empty() && *name.begin() == "..")) name = name.filename();
  return folder / (without_extension(name.generic_string()) + ".png");
}

}  // namespace gs
