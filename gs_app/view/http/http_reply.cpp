// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/http/http_reply.h"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>

#include "gs_core/error.h"

namespace gs {
namespace {

// Of every answer. The page must not be kept, and no page of another server may embed or read what
// is served.
constexpr const char* kHeaders =
    "Cache-Control: no-store\r\n"
    "X-Content-Type-Options: nosniff\r\n"
    "X-Frame-Options: SAMEORIGIN\r\n"
    "Cross-Origin-Resource-Policy: same-origin\r\n"
    "Connection: close\r\n";

const char* words_of(int status) {
  switch (status) {
    case 200: return "OK";
    case 206: return "Partial Content";
    case 400: return "Bad Request";
    case 403: return "Forbidden";
    case 404: return "Not Found";
    case 409: return "Conflict";
    case 413: return "Content Too Large";
    case 416: return "Range Not Satisfiable";
    case 431: return "Request Header Fields Too Large";
    case 502: return "Bad Gateway";
    case 507: return "Insufficient Storage";
    default: return "Internal Server Error";
  }
}

Descriptor opened(const std::filesystem::path& path) {
  Descriptor file(
      ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));  // no FIFO is waited for
  struct stat status {};
  if (file < 0 || ::fstat(file, &status) != 0 || !S_ISREG(status.st_mode))
    throw Error("cannot read " + path.string() + "; has it been moved?");
  return file;
}

std::uint64_t bytes_of(const Descriptor& file) {
  struct stat status {};
  return ::fstat(file, &status) == 0 ? std::uint64_t(status.st_size) : 0;
}

std::string head_of(const HttpAnswer& answer, std::uint64_t body_bytes) {
  std::string head =
      fmt::format("HTTP/1.1 {} {}\r\nContent-Type: {}\r\nContent-Length: {}\r\n{}", answer.status,
                  words_of(answer.status), answer.type, body_bytes, kHeaders);
  for (const auto& [name, value] : answer.headers) head += name + ": " + value + "\r\n";
  return head + "\r\n";
}

}  // namespace

std::optional<ByteRange> range_of(std::string_view header, std::uint64_t bytes) {
  constexpr std::string_view kUnit = "bytes=";
  if (!header.starts_with(kUnit)) return std::nullopt;
  const char* const end = header.data() + header.size();
  ByteRange range{0, bytes == 0 ? 0 : bytes - 1};
  const auto [dash, error] = std::from_chars(header.data() + kUnit.size(), end, range.first);
  if (error != std::errc() || dash == end || *dash != '-') return std::nullopt;
  if (dash + 1 < end) {
    std::uint64_t last = 0;
    const auto [rest, no_number] = std::from_chars(dash + 1, end, last);
    if (no_number != std::errc() || rest != end || last < range.first) return std::nullopt;
    range.last = std::min(range.last, last);
  }
  if (range.first >= bytes) range.first = bytes;
  return range;
}

HttpReply::HttpReply(const HttpAnswer& answer, bool has_body, std::string_view range)
    : body_(answer.body) {
  if (!answer.file.empty()) file_.emplace(opened(answer.file));
  const std::uint64_t all = file_ ? bytes_of(*file_) : body_ ? body_->size() : 0;
  body_bytes_ = all;
  HttpAnswer part = answer;
  if (answer.status == 200 && file_) part.headers.emplace_back("Accept-Ranges", "bytes");
  if (const auto wanted = range_of(range, all); wanted && answer.status == 200) {
    const bool is_there = wanted->first < all;
    part.status = is_there ? 206 : 416;
    body_begin_ = is_there ? wanted->first : 0;
    body_bytes_ = is_there ? wanted->last - wanted->first + 1 : 0;
    part.headers.emplace_back(
        "Content-Range", is_there ? fmt::format("bytes {}-{}/{}", wanted->first, wanted->last, all)
                                  : fmt::format("bytes */{}", all));
  }
  head_ = head_of(part, body_bytes_);
  if (!has_body) body_bytes_ = 0;
}

std::string_view HttpReply::next(std::vector<char>& space) const {
  if (sent_ < head_.size()) return std::string_view(head_).substr(sent_);
  const std::uint64_t done = sent_ - head_.size(), from = body_begin_ + done;
  const auto count = std::size_t(std::min<std::uint64_t>(body_bytes_ - done, space.size()));
  if (!file_) return std::string_view(*body_).substr(from, count);
  const ssize_t read = ::pread(*file_, space.data(), count, off_t(from));
  return {space.data(), read > 0 ? std::size_t(read) : 0};
}

}  // namespace gs
