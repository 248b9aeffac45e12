// SPDX-License-Identifier: Apache-2.0
// A folder for files that nobody keeps.
#pragma once

#include <stdlib.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <string>

#include "gs_core/error.h"

namespace gs {

/// A new folder under the system's folder for temporary files ($TMPDIR), which only this user may enter; it goes with all
/// that is in it.
class ScratchFolder {
 public:
  /// Throws Error where none can be made.
  ScratchFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "gemsplat-XXXXXX").string();
    if (!mkdtemp(name.data()))
      throw Error("cannot make a folder " + name + ": " + std::strerror(errno) +
                  "; name one that may be written to with TMPDIR");
    path_ = name;
  }
  ~ScratchFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace gs
