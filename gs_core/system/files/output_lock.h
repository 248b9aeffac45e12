// SPDX-License-Identifier: Apache-2.0
// Keeps two processes from writing to one output at the same time. Every verb that writes a file or a
// folder of a user's holds such a lock, from the check whether its place is free to the end.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gs {

/// Holds the lock of an output (flock) while it lives. The lock file of a folder lies in the folder,
/// so that every path to the folder leads to it, and nothing above the folder need be written to.
/// The lock file of a single file lies beside it. A lock file without a process that holds it means
/// nothing, so a kill leaves no obstacle.
///
/// Child processes that are started meanwhile hold the lock, too: it is free when all of them have
/// ended. On a file system without locks there is a warning, and no lock.
class OutputLock {
 public:
  enum class Kind { alone, shared };

  /// The lock of a folder, which is made if it is not there. Throws Error if the folder cannot be
  /// written to, and Error that names the folder and the process if another process holds the lock.
  /// If that process is dead and only its children are left, waits for them, a minute at most.
  static OutputLock of_folder(const std::filesystem::path& folder, Kind kind = Kind::alone) {
    return {folder, folder, kind};
  }
  /// Locks a folder that must be new or empty. Throws UsageError if it is not.
  static OutputLock of_new_folder(const std::filesystem::path& folder);
  /// Locks a folder that holds nothing from here on: what an older one held is moved to
  /// FOLDER.bak-N. Throws UsageError if a path of `needed` lies in it.
  static OutputLock of_freed_folder(const std::filesystem::path& folder,
                                    const std::vector<std::filesystem::path>& needed);
  /// The lock of a single file.
  static OutputLock of_file(const std::filesystem::path& file);

  /// Removes the lock file, and the folders that the lock had to make if they are still empty.
  ~OutputLock();
  OutputLock(OutputLock&& other) noexcept;
  OutputLock& operator=(OutputLock&&) = delete;

  /// Moves the folder to FOLDER.bak-N, makes it anew, and locks the new one. Throws UsageError if a
  /// path of `needed` lies in it (check_may_move()). Returns the backup's path.
  std::filesystem::path move_folder_aside(const std::vector<std::filesystem::path>& needed);

 private:
  OutputLock(const std::filesystem::path& output, const std::filesystem::path& folder, Kind kind);
  std::string name_of_output() const;
  void make_folder();
  void acquire();
  void release(const std::filesystem::path& file);

  std::filesystem::path output_;  // as messages name it
  std::filesystem::path folder_, file_;
  Kind kind_;
  int descriptor_ = -1;
  std::vector<std::filesystem::path> made_;  // folders, the innermost first
};

/// Whether a folder holds nothing, or nothing but the file of its lock.
bool is_empty_output(const std::filesystem::path& folder);

}  // namespace gs
