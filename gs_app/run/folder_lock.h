// SPDX-License-Identifier: Apache-2.0
// Two programs that must not work on one folder at the same time.
#pragma once

#include <filesystem>

namespace gs {

/// Holds a file's lock (flock) while it lives, and so do children that are started meanwhile: the lock is free when all
/// of them have ended, however they ended. The file means nothing without its lock. Where the file system knows no locks there
/// is a warning and none.
class FolderLock {
 public:
  enum class Kind { alone, shared };
  enum class File { stays, removed };  // when the lock ends
  /// `file` is the lock of `folder`. Throws Error that names that and the holder where another process has it. Where the holder itself is dead and only its
  /// children are left, waits for them, a minute at most.
  FolderLock(const std::filesystem::path& file, const std::filesystem::path& folder, Kind kind,
             File afterwards = File::stays);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  std::filesystem::path file_;
  File afterwards_;
  int descriptor_ = -1;
};

}  // namespace gs
