// SPDX-License-Identifier: Apache-2.0
// Writes a file either completely or not at all: first without a name, or under a temporary one
// where the file system has no files without names; it gets its own when everything is on disk.
#pragma once

#include <cstdio>
#include <filesystem>
#include <functional>
#include <string_view>

#include "gs_core/system/files/byte_sink.h"

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
/// else. Files of processes that still run stay. With `file_name`, only those for this file and the
/// ones beside it that begin with its name, such as its sidecar.
void remove_leftovers(const std::filesystem::path& folder, const std::string& file_name = "");

/// Makes an empty file beside `path` for a program that writes only to a name, such as a film's
/// encoder: ".NAME.PROCESS.RANDOM" and `ending`. The name cannot be guessed, and the file is new, so
/// nobody can have put a link there. Throws Error, which names `path`.
std::filesystem::path make_temporary_beside(const std::filesystem::path& path,
                                            std::string_view ending);

/// A file that is being written. Order of calls: construct, write() any number of times, commit().
/// Without commit(), say after an exception or a kill, nothing is left behind, and an older file of
/// that name is untouched. (A kill leaves a hidden file on file systems that have no files without
/// names, such as NFS: remove_leftovers().) Every function throws Error, which names the path, if
/// the disk is full or the folder may not be written to.
class AtomicFile : public ByteSink {
 public:
  /// Creates the folder above `path` if it is not there, and a file in it.
  explicit AtomicFile(std::filesystem::path path);
  ~AtomicFile() override;
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  std::string name() const override { return named_.string(); }
  using ByteSink::write;
  void write(const void* data, std::size_t bytes) override;
  /// synced: the file survives a power cut after commit(). unsynced: it may not, and commit() is
  /// faster.
  enum class Durability { synced, unsynced };
  /// Brings everything to the disk and gives the file its name. Right before that it calls
  /// before_naming() where there is one: the place to remove what described an older file.
  void commit(Durability durability = Durability::synced,
              const std::function<void()>& before_naming = {});

 private:
  [[noreturn]] void fail(int error);
  int give_name();

  std::filesystem::path named_;             // by the caller; a symbolic link leads to path_
  std::filesystem::path path_, temporary_;  // temporary_: empty while the file has no name
  std::FILE* file_ = nullptr;
};

}  // namespace gs
