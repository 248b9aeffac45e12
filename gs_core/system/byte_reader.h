// SPDX-License-Identifier: Apache-2.0
// Reads a file once, front to back, in large blocks. The reader always knows how many bytes are
// left, so that a count in a file's header can be checked before memory is allocated for it.
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

/// One regular file, read front to back. The results of take(), peek() and take_line() stay valid
/// until the next call. Every function throws Error, which names the file, if the file ends too
/// early or the disk fails.
class ByteReader {
 public:
  /// Throws Error if the file is missing, is a folder, or may not be read.
  explicit ByteReader(std::filesystem::path path);

  const std::filesystem::path& path() const { return path_; }
  std::uint64_t size() const { return size_; }                        // bytes in the file
  std::uint64_t position() const { return read_ - (end_ - begin_); }  // of the next byte
  std::uint64_t left() const { return size_ - position(); }           // bytes that follow

  /// The next `bytes` bytes, without taking them.
  const std::uint8_t* peek(std::size_t bytes);
  const std::uint8_t* take(std::size_t bytes);
  void skip(std::uint64_t bytes);
  /// The next line without its line feed; nothing if no whole line follows.
  std::optional<std::string_view> take_line();

 private:
  void fill(std::size_t bytes);

  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::filesystem::path path_;
  std::unique_ptr<std::FILE, Close> file_;
  std::uint64_t size_ = 0;
  std::uint64_t read_ = 0;  // bytes of the file that were read into the buffer or skipped
  std::vector<std::uint8_t> buffer_;
  std::size_t begin_ = 0, end_ = 0;  // the part of the buffer that was not taken yet
};

}  // namespace gs
