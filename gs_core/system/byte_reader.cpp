// SPDX-License-Identifier: Apache-2.0
#include "gs_core/system/byte_reader.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "gs_core/error.h"
#include "gs_core/system/files/access.h"

namespace gs {
namespace {

constexpr std::size_t kBlockBytes = std::size_t(1) << 20;  // one read; larger ones are not faster
constexpr std::size_t kLongestLineBytes = std::size_t(1) << 26;  // a longer line is not text

}  // namespace

void cannot_read(const std::filesystem::path& path, const std::string& what) {
  throw Error(fmt::format("cannot read {}: {}", path.string(), what));
}

ByteReader::ByteReader(std::filesystem::path path) : path_(std::move(path)) {
  std::error_code error;
  const auto status = std::filesystem::status(path_, error);
  if (status.type() == std::filesystem::file_type::none)
    cannot_access(path_, error.message() + "; check its permissions and the disk");
  if (!std::filesystem::exists(status)) cannot_read(path_, "there is no such file; check the path");
  if (std::filesystem::is_directory(status)) {
    cannot_read(path_, "this is a folder; name a file in it");
  }
  if (!std::filesystem::is_regular_file(status)) {
    cannot_read(path_, "this is not a regular file; save it to disk first");
  }
  file_.reset(std::fopen(path_.c_str(), "rb"));
  if (!file_) cannot_access(path_, fmt::format("{}; check its permissions", std::strerror(errno)));
  size_ = std::filesystem::file_size(path_, error);
  if (error) cannot_access(path_, error.message() + "; check the disk");
}

const std::uint8_t* ByteReader::peek(std::size_t bytes) {
  if (bytes > end_ - begin_) fill(bytes);
  return buffer_.data() + begin_;
}

const std::uint8_t* ByteReader::take(std::size_t bytes) {
  const std::uint8_t* result = peek(bytes);
  begin_ += bytes;
  return result;
}

void ByteReader::skip(std::uint64_t bytes) {
  if (bytes <= end_ - begin_) {
    begin_ += bytes;
    return;
  }
  if (bytes > left()) {
    cannot_read(path_, fmt::format("{} bytes short at byte {}; the file is cut short, copy or "
                                   "export it again",
                                   bytes - left(), size_));
  }
  read_ = position() + bytes;
  begin_ = end_ = 0;
  if (fseeko(file_.get(), off_t(read_), SEEK_SET) != 0) {
    cannot_access(path_, fmt::format("{} at byte {}; check the disk", std::strerror(errno), read_));
  }
}

std::optional<std::string_view> ByteReader::take_line() {
  std::size_t searched = 0;
  for (;;) {
    const std::uint8_t* start = buffer_.data() + begin_;
    const std::size_t held = end_ - begin_;
    if (held > searched) {
      if (const void* found = std::memchr(start + searched, '\n', held - searched)) {
        const std::size_t length = static_cast<const std::uint8_t*>(found) - start;
        begin_ += length + 1;
        return std::string_view(reinterpret_cast<const char*>(start), length);
      }
    }
    if (held == left()) return std::nullopt;
    if (held > kLongestLineBytes) {
      cannot_read(path_, fmt::format("no line ends after byte {}; the file is damaged, export it "
                                     "again",
                                     position()));
    }
    searched = held;
    fill(std::size_t(std::min<std::uint64_t>(left(), std::max(2 * held, kBlockBytes))));
  }
}

// Reads until at least `bytes` bytes are in the buffer, and more if they fit into the block.
void ByteReader::fill(std::size_t bytes) {
  if (bytes > left()) {
    cannot_read(path_, fmt::format("{} bytes short at byte {}; the file is cut short, copy or "
                                   "export it again",
                                   bytes - left(), size_));
  }
  const std::size_t held = end_ - begin_;
  if (held) std::memmove(buffer_.data(), buffer_.data() + begin_, held);
  begin_ = 0;
  end_ = held;
  const auto wanted_size =
      std::max(bytes, std::size_t(std::min<std::uint64_t>(held + (size_ - read_), kBlockBytes)));
  if (buffer_.size() < wanted_size) buffer_.resize(wanted_size);
  const std::size_t wanted =
      std::size_t(std::min<std::uint64_t>(size_ - read_, buffer_.size() - held));
  const std::size_t got = std::fread(buffer_.data() + held, 1, wanted, file_.get());
  read_ += got;
  end_ += got;
  if (got == wanted) return;
  cannot_access(path_,
                fmt::format("{} at byte {}; check the disk",
                            std::ferror(file_.get()) ? std::strerror(errno)
                                                     : "the file became shorter while it was read",
                            read_));
}

}  // namespace gs
