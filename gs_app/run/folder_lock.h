// SPDX-License-Identifier: Apache-2.0
// Keeps two processes from working on one folder at the same time.
#pragma once

#include <filesystem>

namespace gs {

/// Holds the lock of a file (flock) while it lives. Child processes that are started meanwhile hold
/// it, too: it is free when all of them have ended, by a kill as well. The file alone, without its
/// lock, has no meaning. On a file system without locks there is a warning, and no lock.
class FolderLock {
 public:
  enum class Kind { alone, shared };
  enum class File { stays, removed };  // when the lock ends
  /// `file` is the lock of `folder`. If another process holds it, throws Error that names the
  /// folder and the process. If that process is dead and only its children are left, waits for
  /// them, a minute at most.
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
