// SPDX-License-Identifier: Apache-2.0
// Asks a server on this machine, as a browser would: one request on each connection.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/raw_connection.h"

namespace gs {

struct HttpGot {
  int status = 0;
  std::string head, body;

  std::string header(const std::string& name) const {
    const std::string start = "\r\n" + name + ": ";
    const std::size_t at = head.find(start);
    if (at == head.npos) return "";
    const std::size_t begin = at + start.size();
    return head.substr(begin, head.find("\r\n", begin) - begin);
  }
};

using HttpHeaders = std::vector<std::pair<std::string, std::string>>;

/// The answer to "GET /path", or nothing if the server ended the connection without one. `headers`
/// may name another host than this machine.
inline std::optional<HttpGot> ask(int port, const std::string& request,
                                  const HttpHeaders& headers = {}) {
  std::string text = request + " HTTP/1.1\r\n";
  bool has_host = false;
  for (const auto& [name, value] : headers) {
    text += name + ": " + value + "\r\n";
    has_host |= name == "Host";
  }
  if (!has_host) text += "Host: localhost\r\n";
  const RawConnection connection(port);
  connection.say(text + "\r\n");
  const std::string answer = connection.answer();
  const std::size_t end = answer.find("\r\n\r\n");
  if (end == answer.npos) return std::nullopt;
  const std::size_t space = answer.find(' ');
  return HttpGot{std::stoi(answer.substr(space + 1)), answer.substr(0, end + 2),
                 answer.substr(end + 4)};
}

}  // namespace gs
