// SPDX-License-Identifier: Apache-2.0
// A binary file of named sections with a checksum at its end, so that a file that is cut short or
// damaged is recognized.
//
//   8 bytes   the kind of the file
//   u32       version of that kind, u32 0
//   sections  name (32 bytes, zeros behind it), u64 bytes, then so many bytes
//   "end"     a section of 8 bytes: the XXH3 hash (64 bits) of all bytes before this section
//
// Numbers are little-endian.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/atomic_file.h"

namespace gs {

/// The XXH3 hash of all bytes so far.
class RunningHash {
 public:
  RunningHash();
  ~RunningHash();
  RunningHash(const RunningHash&) = delete;
  RunningHash& operator=(const RunningHash&) = delete;
  void add(const void* data, std::size_t bytes);
  std::uint64_t value() const;

 private:
  void* state_;
};

/// The kind of a file, 8 characters, and the versions of it that are read. The newest is written.
struct FileKind {
  std::string_view name;
  std::uint32_t oldest, version;
};

/// Writes such a file, completely or not at all. Order of calls: section(), write() of as many
/// bytes as section() announced, ..., commit(). Throws Error as AtomicFile does.
class CheckedWriter {
 public:
  CheckedWriter(std::filesystem::path path, const FileKind& kind);
  void section(std::string_view name, std::uint64_t bytes);
  void write(const void* data, std::size_t bytes);
  /// A section that holds a text.
  void text(std::string_view name, std::string_view text);
  void commit();

 private:
  AtomicFile file_;
  RunningHash hash_;
  std::uint64_t owed_ = 0;  // bytes of the section that were not written yet
};

/// Reads such a file, section by section in the order of writing. Do not trust what was read before
/// finish() has checked the checksum. Throws Error "cannot read PATH: ..." if the file is not as it
/// was written.
class CheckedReader {
 public:
  CheckedReader(std::filesystem::path path, const FileKind& kind);
  /// Begins the next section, which must have this name, and returns its size in bytes.
  std::uint64_t section(std::string_view name);
  /// Reads the next bytes of the section.
  void read(void* to, std::size_t bytes);
  std::string text(std::string_view name);
  /// That of the file.
  std::uint32_t version() const { return version_; }
  /// A section that holds plain values.
  template <class T>
  std::vector<T> values(std::string_view name) {
    static_assert(std::is_trivially_copyable_v<T>);
    const std::uint64_t bytes = section(name);
    if (bytes % sizeof(T)) damaged();
    std::vector<T> values(bytes / sizeof(T));
    read(values.data(), bytes);
    return values;
  }
  void finish();
  [[noreturn]] void damaged();

 private:
  std::string next_name();  // with the zeros behind it

  ByteReader reader_;
  RunningHash hash_;
  std::uint32_t version_ = 0;
  std::uint64_t left_ = 0;  // bytes of the section that were not read yet
};

}  // namespace gs
