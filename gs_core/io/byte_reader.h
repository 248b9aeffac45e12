// SPDX-License-Identifier: Apache-2.0
// Reads a file once, front to back, in big blocks; knows at any time how much of it is left, so
// that a promise in a header can be checked before memory is asked for.
#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

/// Throws Error "cannot read PATH: WHAT".
[[noreturn]] void cannot_read(const std::filesystem::path& path, const std::string& what);

/// One regular file, read front to back. What take(), peek() and take_line() return stays valid
/// until the next call. Every function throws Error, naming the file, where the file ends too early
/// or the disk fails.
class ByteReader {
 public:
  /// Throws Error for a file that is missing, a folder, or may not be read.
  explicit ByteReader(std::filesystem::path path);

  const std::filesystem::path& path() const { return path_; }
  std::uint64_t size() const { return size_; }                        // bytes in the file
  std::uint64_t position() const { return read_ - (end_ - begin_); }  // of the next byte
  std::uint64_t left() const { return size_ - position(); }           // bytes that follow

  /// The next `bytes` bytes, which stay the next ones.
  const std::uint8_t* peek(std::size_t bytes);
  const std::uint8_t* take(std::size_t bytes);
  void skip(std::uint64_t bytes);
  /// The next line without its line feed; nothing where no whole line follows.
  std::optional<std::string_view> take_line();

 private:
  void fill(std::size_t bytes);

  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::filesystem::path path_;
  std::unique_ptr<std::FILE, Close> file_;
  std::uint64_t size_ = 0;
  std::uint64_t read_ = 0;  // bytes of the file that have come into the buffer, or were skipped
  std::vector<std::uint8_t> buffer_;
  std::size_t begin_ = 0, end_ = 0;  // the part of the buffer that is still to be taken
};

}  // namespace gs
