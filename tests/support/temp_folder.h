// SPDX-License-Identifier: Apache-2.0
// A folder of its own for a test that writes files.
#pragma once

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "gs_core/system/files/scratch_folder.h"

namespace gs {

/// An empty folder, removed with all that it holds at the end.
class TempFolder : public ScratchFolder {
 public:
  TempFolder() : ScratchFolder("gemsplat-test-") {}
};

/// Writes `bytes` to a file, making the folders above it.
inline void write_bytes(const std::filesystem::path& file, const std::string& bytes) {
  std::filesystem::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << bytes;
}

/// All bytes of a file.
inline std::string read_bytes(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

}  // namespace gs
