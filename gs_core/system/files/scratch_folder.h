// SPDX-License-Identifier: Apache-2.0
// A folder for files that are only needed for a while.
#pragma once

#include <filesystem>
#include <string>

namespace gs {

/// A new folder under the system's folder for temporary files ($TMPDIR), which only this user may
/// enter. It is removed at the end with all that it holds; where a kill prevents that, by the next
/// one of the same prefix. A lock beside the files tells which folders belong to a process that
/// lives: TMPDIR/PREFIXxxxxxx/ has `.gemsplat.scratch` and `files/`.
class ScratchFolder {
 public:
  /// Its name begins with `prefix`. Throws Error if it cannot be made.
  explicit ScratchFolder(const std::string& prefix = "gemsplat-");
  ~ScratchFolder();
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }

 private:
  bool make(const std::string& pattern);
  void remove() const;

  std::filesystem::path folder_, path_;
  int lock_ = -1;  // held until the folder is gone
};

}  // namespace gs
