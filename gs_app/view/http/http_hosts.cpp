// SPDX-License-Identifier: Apache-2.0
// The parts of http_server.h that need no library: names of hosts, and answers.
#include <arpa/inet.h>

#include "gs_app/view/http/http_server.h"
#include "gs_core/system/host_name.h"
#include "gs_core/system/text/ascii.h"

namespace gs {
namespace {

// "[::1]:7070" -> "::1", "localhost:7070" -> "localhost", "::1" as it is
std::string without_port(const std::string& host) {
  if (host.starts_with('[')) return host.substr(1, host.find(']') - 1);
  const std::size_t colon = host.find(':');
  return colon == host.rfind(':') ? host.substr(0, colon) : host;
}

bool is_address(const std::string& host) {
  unsigned char bytes[sizeof(in6_addr)];
  return inet_pton(AF_INET, host.c_str(), bytes) == 1 ||
         inet_pton(AF_INET6, host.c_str(), bytes) == 1;
}

// `name` is in lower case and has no port.
bool is_loopback_name(const std::string& name) {
  return name == "localhost" || name == "::1" || (name.starts_with("127.") && is_address(name));
}

}  // namespace

bool is_loopback(const std::string& host) {
  return is_loopback_name(lowercase(without_port(host)));
}

bool is_own_host(const std::string& named, const std::string& host) {
  const std::string name = lowercase(without_port(named)), own = lowercase(without_port(host));
  if (name.empty()) return false;
  if (name == own || is_loopback_name(name)) return true;
  return !is_loopback_name(own) && (is_address(name) || name == lowercase(host_name()));
}

HttpAnswer http_text(std::string text, std::string type) {
  HttpAnswer answer;
  answer.type = std::move(type);
  answer.body = std::make_shared<const std::string>(std::move(text));
  return answer;
}

HttpAnswer http_error(int status, std::string sentence) {
  HttpAnswer answer = http_text(std::move(sentence), HttpAnswer().type);
  answer.status = status;
  return answer;
}

}  // namespace gs
