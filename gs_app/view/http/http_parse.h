// SPDX-License-Identifier: Apache-2.0
// The head of an HTTP/1 request: its first line and its headers.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "gs_app/view/http/http_server.h"

namespace gs {

struct HttpHead {
  std::string method;                                             // "GET"
  HttpRequest request;                                            // without `client`
  std::vector<std::pair<std::string, std::string>> headers = {};  // names in lower case

  std::size_t count(std::string_view name) const;
  /// The first value of a header, or "".
  std::string value(std::string_view name) const;
};

/// The length of the head at the begin of `bytes`, with the empty line that ends it; 0 as long as it
/// is not complete. `known` bytes were looked at before.
std::size_t head_length(std::string_view bytes, std::size_t known);

/// Parses a complete head. Returns nothing if it is malformed: lines that do not end with CR LF,
/// control characters, header names with spaces, folded headers, addresses that do not begin with /.
std::optional<HttpHead> parse_head(std::string_view head);

}  // namespace gs
