// SPDX-License-Identifier: Apache-2.0
// A folder for files that are only needed for a while.
#pragma once

#include <stdlib.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <string>

#include "gs_core/error.h"

namespace gs {

/// A new folder under the system's folder for temporary files ($TMPDIR), which only this user may
/// enter. It is removed at the end with all that it holds.
class ScratchFolder {
 public:
  /// Its name begins with `prefix`. Throws Error if it cannot be made.
  explicit ScratchFolder(const std::string& prefix = "gemsplat-") {
    std::string name = (std::filesystem::temp_directory_path() / (prefix + "XXXXXX")).string();
    if (!mkdtemp(name.data()))
      throw Error("cannot make a folder " + name + ": " + std::strerror(errno) +
                  "; set TMPDIR to a folder that you may write to");
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
