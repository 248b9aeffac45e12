// SPDX-License-Identifier: Apache-2.0
// In a build without OpenImageIO.
#include <spdlog/fmt/fmt.h>

#include "data_loaders/photos/exr.h"
#include "gs_core/error.h"

namespace gs {

bool can_write_exr() { return false; }
std::string cannot_write_exr() {
  return "this build has no OpenImageIO; write PNG (--format png), or install libopenimageio-dev "
         "and build again";
}

void write_exr(const std::filesystem::path& path, const ImageF&, const std::vector<std::string>&) {
  throw Error(fmt::format("cannot write {}: {}", path.string(), cannot_write_exr()));
}

ImageF read_exr(const std::filesystem::path& path, std::vector<std::string>*) {
  throw Error(fmt::format("cannot read {}: {}", path.string(), cannot_write_exr()));
}

}  // namespace gs
