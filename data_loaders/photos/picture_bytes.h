// SPDX-License-Identifier: Apache-2.0
// Bytes of a picture file, for the readers of headers.
#pragma once

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "data_loaders/photos/photo_codec.h"

namespace gs {

/// Reads parts of a regular file; what lies behind its end is missing.
class PictureFile {
 public:
  explicit PictureFile(const std::filesystem::path& path) : path_(path) {
    // Without O_NONBLOCK, opening a FIFO waits for its writer.
    descriptor_ = ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (descriptor_ < 0) cannot_access_photo(path);
    struct stat status {};
    if (::fstat(descriptor_, &status) == 0 && S_ISREG(status.st_mode)) {
      size_ = std::uint64_t(status.st_size);
      return;
    }
    ::close(descriptor_);
    cannot_read_photo(path, "it is not a regular file");
  }
  ~PictureFile() { ::close(descriptor_); }
  PictureFile(const PictureFile&) = delete;
  PictureFile& operator=(const PictureFile&) = delete;

  std::uint64_t size() const { return size_; }
  std::string bytes(std::uint64_t offset, std::size_t count) const {
    std::string result(std::size_t(std::min<std::uint64_t>(count, size_ - std::min(offset, size_))),
                       '\0');
    std::size_t done = 0;
    while (done < result.size()) {
      const ssize_t got =
          ::pread(descriptor_, result.data() + done, result.size() - done, off_t(offset + done));
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) cannot_access_photo(path_);
      if (got == 0) break;  // it became shorter meanwhile
      done += std::size_t(got);
    }
    result.resize(done);
    return result;
  }

 private:
  const std::filesystem::path& path_;
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
};

/// A number of `count` bytes, the most significant first; 0 where the bytes end before it.
inline std::uint64_t big(std::string_view bytes, std::size_t at, std::size_t count) {
  std::uint64_t value = 0;
  if (at > bytes.size() || count > bytes.size() - at) return 0;
  for (std::size_t i = 0; i < count; ++i)
    value = value << 8 | static_cast<unsigned char>(bytes[at + i]);
  return value;
}
/// A number of `count` bytes, the least significant first; 0 where the bytes end before it.
inline std::uint64_t little(std::string_view bytes, std::size_t at, std::size_t count) {
  std::uint64_t value = 0;
  if (at > bytes.size() || count > bytes.size() - at) return 0;
  for (std::size_t i = count; i-- > 0;)
    value = value << 8 | static_cast<unsigned char>(bytes[at + i]);
  return value;
}

}  // namespace gs
