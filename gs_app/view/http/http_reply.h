// SPDX-License-Identifier: Apache-2.0
// An answer as bytes: a head, and a body that is in memory or in a file.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "gs_app/view/http/http_server.h"
#include "gs_core/system/processes/process.h"

namespace gs {

/// Bytes `first`, ..., `last` of a body.
struct ByteRange {
  std::uint64_t first, last;
};

/// The range that a Range header asks for in a body of `bytes` bytes, cut off at its end:
/// "bytes=5-9" or "bytes=5-". Nothing for other headers, such as those of several ranges: they get
/// the whole body, as RFC 9110 allows. If it begins behind the body, `first` is `bytes`.
std::optional<ByteRange> range_of(std::string_view header, std::uint64_t bytes);

/// The bytes of an answer, and how many of them were sent.
class HttpReply {
 public:
  /// Opens the answer's file. Without `has_body` (HEAD), only the head is sent. With a `range`
  /// (range_of()), an answer with the status 200 becomes a part of its body, with 206. Throws Error
  /// if the file cannot be read.
  explicit HttpReply(const HttpAnswer& answer, bool has_body = true, std::string_view range = {});

  bool is_sent() const { return sent_ == head_.size() + body_bytes_; }
  /// The next bytes to send, at most as many as fit into `space`, which may hold them. Empty if the
  /// file has become shorter.
  std::string_view next(std::vector<char>& space) const;
  void count_sent(std::size_t bytes) { sent_ += bytes; }

 private:
  std::string head_;
  std::shared_ptr<const std::string> body_;
  std::optional<Descriptor> file_;
  std::uint64_t body_begin_ = 0;  // of the bytes to be sent
  std::uint64_t body_bytes_ = 0;  // to be sent
  std::uint64_t sent_ = 0;
};

}  // namespace gs
