// SPDX-License-Identifier: Apache-2.0
// A small HTTP server in which one function answers every GET request. It is meant for people who
// look at their own files: unless told otherwise it listens only to this machine, and it refuses
// requests that another web page makes a browser send (DNS rebinding). It is built on cpp-httplib,
// which only http_server.cpp includes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace gs {

struct HttpRequest {
  std::string path;  // "/photo/12", decoded
  std::map<std::string, std::string> query;
  std::string client;  // its address
};

struct HttpAnswer {
  int status = 200;
  std::string type = "text/plain; charset=utf-8";
  std::shared_ptr<const std::string> body;  // the body, or
  std::filesystem::path file;               // the file that is sent as the body, piece by piece
  std::vector<std::pair<std::string, std::string>> headers = {};
};

HttpAnswer http_text(std::string text, std::string type);
/// An error with a sentence for people.
HttpAnswer http_error(int status, std::string sentence);

/// Called from several threads at a time. An exception becomes status 500 with the exception's
/// message.
using HttpHandler = std::function<HttpAnswer(const HttpRequest&)>;

inline constexpr int kFirstPort = 7070;

/// The address to listen at.
struct HttpPlace {
  std::string host = "127.0.0.1";
  int port = -1;  // 0: any free port; -1: the first free one from kFirstPort on
};

/// Whether a server that listens at `host` accepts a request whose Host header is `named`, with or
/// without a port. A server at a loopback address accepts the loopback's names and `host` itself.
/// Any other server also accepts this machine's name and every numeric address, because a name
/// server cannot redirect those.
bool is_own_host(const std::string& named, const std::string& host);

/// Whether only this machine can reach the address.
bool is_loopback(const std::string& host);

/// Serves from construction to destruction, on its own threads of low priority.
class HttpServer {
 public:
  /// Throws Error if the port is taken, the host is not an address of this machine, or this build
  /// has no server.
  HttpServer(const HttpPlace& place, HttpHandler handler);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  int port() const;
  /// "http://127.0.0.1:7070/"
  std::string url() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Whether this build has cpp-httplib. If not, cannot_serve() says so and what to do.
bool can_serve();
std::string cannot_serve();

}  // namespace gs
