// SPDX-License-Identifier: Apache-2.0
// Writes a file that is there whole or not at all: under a temporary name first, renamed when it is
// on disk.
#pragma once

#include <cstdio>
#include <filesystem>
#include <string_view>

namespace gs {

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
