// SPDX-License-Identifier: Apache-2.0
// Two programs that must not work on one folder at the same time.
#pragma once

#include <filesystem>

namespace gs {

/// Holds a file's lock (flock) while it lives, and so do children that are started meanwhile: the lock is free when all
/// of them have ended, however they ended. The file stays, and means nothing without its lock.
class FolderLock {
 public:
  enum class Kind { alone, shared };
  /// Throws Error that names the holder where another process has it. Where the holder itself is dead and only its
  /// children are left, waits for them, a minute at most.
  FolderLock(const std::filesystem::path& file, Kind kind);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int descriptor_ = -1;
};

}  // namespace gs
