// SPDX-License-Identifier: Apache-2.0
// Writes a file that is there whole or not at all: under a temporary name first, renamed when it is
// on disk.
#pragma once

#include <cstdio>
#include <filesystem>
#include <string_view>

namespace gs {

/// Where an AtomicFile is on its way to the disk.
enum class WritePoint { create, write, sync, rename, sync_folder };

/// For tests of what a kill or a full disk leaves behind: asked before each of these, it may end the process, or throw.
class WriteHook {
 public:
  virtual ~WriteHook() = default;
  virtual void before(WritePoint point, const std::filesystem::path& file) = 0;
};
/// One for the whole program; null, as at the start: none.
void set_write_hook(WriteHook* hook);

/// Removes the temporary files that killed processes left in a folder, and nothing else: those of AtomicFile whose
/// process is gone.
void remove_leftovers(const std::filesystem::path& folder);

/// One file in the making. Order of calls: construct, write() any number of times, commit().
/// Without commit() (say, an exception came between) nothing is left and an older file of that name
/// is untouched.
/// Every function throws Error with the path where the disk is full or may not be written to.
class AtomicFile {
 public:
  /// Creates the folder above `path` if it is not there, and a temporary file in it.
  explicit AtomicFile(std::filesystem::path path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  void write(const void* data, std::size_t bytes);
  void write(std::string_view text) { write(text.data(), text.size()); }
  /// Whether what commit() wrote outlives a power cut. Where it need not, it costs less time.
  enum class Durability { synced, unsynced };
  /// Brings everything to the disk and gives the file its name.
  void commit(Durability durability = Durability::synced);

 private:
  [[noreturn]] void fail(int error);

  std::filesystem::path path_, temporary_;
  std::FILE* file_ = nullptr;
};

}  // namespace gs
