// SPDX-License-Identifier: Apache-2.0
// http_server.h in a build without cpp-httplib.
#include "gs_app/view/http/http_server.h"
#include "gs_core/error.h"

namespace gs {

struct HttpServer::Impl {};

HttpServer::HttpServer(const HttpPlace&, HttpHandler) { throw Error(cannot_serve()); }
HttpServer::~HttpServer() = default;
int HttpServer::port() const { return 0; }
std::string HttpServer::url() const { return {}; }

bool can_serve() { return false; }
std::string cannot_serve() {
  return "this build cannot serve the viewer, because cpp-httplib was missing: install "
         "libcpp-httplib-dev and "
         "pkg-config and build again";
}

}  // namespace gs
