// SPDX-License-Identifier: Apache-2.0
// A small HTTP server over cpp-httplib, which only http_server.cpp sees: one function answers every GET. Built for people who
// look at their own files: it listens to this machine alone unless told otherwise, and answers no request that a foreign
// web page has a browser send (DNS rebinding).
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
  std::string client;  // address
};

struct HttpAnswer {
  int status = 200;
  std::string type = "text/plain; charset=utf-8";
  std::shared_ptr<const std::string> body;  // or
  std::filesystem::path file;               // whose bytes are the body, read piece by piece
  std::vector<std::pair<std::string, std::string>> headers = {};
};

HttpAnswer http_text(std::string text, std::string type);
/// An error's sentence, for people.
HttpAnswer http_error(int status, std::string sentence);

/// Called from several threads at a time. What it throws becomes status 500 with the exception's words.
using HttpHandler = std::function<HttpAnswer(const HttpRequest&)>;

inline constexpr int kFirstPort = 7070;

/// Where to listen.
struct HttpPlace {
  std::string host = "127.0.0.1";
  int port = -1;  // 0: any that is free; -1: the first free one from kFirstPort on
};

/// Whether a request may name `named` as its Host (with or without a port) where `host` is listened at. Loopback addresses
/// answer to the names of the loopback and to what was given; others also to any address in digits, which no name server can
/// turn over to somebody else, and to this machine's name.
bool is_own_host(const std::string& named, const std::string& host);

/// Whether only this machine reaches it.
bool is_loopback(const std::string& host);

/// Serves from construction to destruction, on threads of its own and of low priority.
class HttpServer {
 public:
  /// Throws Error where the place is taken or no address of this machine, and where this build cannot serve.
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

/// Whether this build has the library. Where it does not, cannot_serve() says so, and what to do.
bool can_serve();
std::string cannot_serve();

}  // namespace gs
