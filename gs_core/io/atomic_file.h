// SPDX-License-Identifier: Apache-2.0
// Writes a file either completely or not at all: under a temporary name first, which is changed
// when everything is on disk.
#pragma once

#include <cstdio>
#include <filesystem>
#include <string_view>

namespace gs {

/// The steps of an AtomicFile on its way to the disk.
enum class WritePoint { create, write, sync, rename, sync_folder };

/// A hook for tests that kill the program or fill the disk. It is called before each step and may
/// end the process or throw.
class WriteHook {
 public:
  virtual ~WriteHook() = default;
  virtual void before(WritePoint point, const std::filesystem::path& file) = 0;
};
/// There is one hook for the whole program; null, the initial value, means none.
void set_write_hook(WriteHook* hook);

/// Removes the temporary files of AtomicFile that killed processes left in a folder, and nothing
/// else. Files of processes that still run stay.
void remove_leftovers(const std::filesystem::path& folder);

/// Makes an empty file beside `path` for a program that writes only to a name, such as a film's
/// encoder: ".NAME.PROCESS.RANDOM" and `ending`. The name cannot be guessed, and the file is new, so
/// nobody can have put a link there. Throws Error, which names `path`.
std::filesystem::path make_temporary_beside(const std::filesystem::path& path,
                                            std::string_view ending);

/// A file that is being written. Order of calls: construct, write() any number of times, commit().
/// Without commit(), say after an exception, nothing is left behind, and an older file of that name
/// is untouched. Every function throws Error, which names the path, if the disk is full or the
/// folder may not be written to.
class AtomicFile {
 public:
  /// Creates the folder above `path` if it is not there, and a temporary file in it.
  explicit AtomicFile(std::filesystem::path path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  void write(const void* data, std::size_t bytes);
  void write(std::string_view text) { write(text.data(), text.size()); }
  /// synced: the file survives a power cut after commit(). unsynced: it may not, and commit() is
  /// faster.
  enum class Durability { synced, unsynced };
  /// Brings everything to the disk and gives the file its name.
  void commit(Durability durability = Durability::synced);

 private:
  [[noreturn]] void fail(int error);

  std::filesystem::path path_, temporary_;
  std::FILE* file_ = nullptr;
};

}  // namespace gs
