// SPDX-License-Identifier: Apache-2.0
// Inputs that hold the arrays of an archive as they are before they are packed.
#pragma once

#include "gs_model/formats/coding/zip_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace gs::fuzz {

/// The arrays of an input, each after a line with its name.
inline std::vector<ZipEntry> named_arrays(std::string_view arrays) {
  std::vector<ZipEntry> entries;
  while (!arrays.empty()) {
    const std::size_t end = arrays.find(kNextFile);
    const std::string_view array = arrays.substr(0, end);
    const std::size_t line = std::min(array.find('\n'), array.size());
    entries.push_back({std::string(array.substr(0, line)),
                       std::string(array.substr(std::min(line + 1, array.size())))});
    if (end == arrays.npos) break;
    arrays.remove_prefix(end + kNextFile.size());
  }
  return entries;
}

}  // namespace gs::fuzz
