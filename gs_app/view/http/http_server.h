// SPDX-License-Identifier: Apache-2.0
// A small HTTP server in which one function answers every request. It is meant for people who
// look at their own files: unless told otherwise it listens only to this machine, and it refuses
// requests that another web page makes a browser send (DNS rebinding). Connections are few, each
// brings one request, and slow ones end in time. A POST is taken of this server's own page alone, or
// of a program that is no browser, and without a body unless HttpLimits says who may send one.
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
  std::string method = "GET";  // or "HEAD" or "POST"
  std::string path;            // "/photo/12", decoded
  std::map<std::string, std::string> query;
  std::string client;  // its address
  std::string token;   // of a POST: the secret in its header X-Control-Token
  std::string range;   // of the bytes that are wanted, as its header has it: "bytes=0-65535"
  std::string body;    // of a POST
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

/// Called from several threads at a time. An exception becomes status 500. Its message goes to
/// the log alone, because it may name folders of this machine.
using HttpHandler = std::function<HttpAnswer(const HttpRequest&)>;

inline constexpr int kFirstPort = 7070;

/// The address to listen at.
struct HttpPlace {
  std::string host = "127.0.0.1";
  int port = -1;  // 0: any free port; -1: the first free one from kFirstPort on
};

/// What connections may cost. Tests set other limits.
struct HttpLimits {
  /// Connections at a time; a browser opens 6. When all are taken, a silent one or a reader that
  /// takes nothing makes way for a new one.
  int connections = 32;
  std::size_t head_bytes = std::size_t(1) << 15;  // of a request: cookies may have some kilobytes
  double head_seconds = 5;     // from the start of a connection to the end of its request's head
  double piece_seconds = 30;   // in which a reader has to take 64 KiB, or a writer to send them
  std::size_t body_bytes = 0;  // of a POST, at most
  /// Whether the body of a POST is read; it is not called for what another page has sent.
  std::function<bool(const HttpRequest&)> may_send_body;
  /// Whether the server's threads have the lowest priority, as beside the threads of a training. A
  /// page of the studio, whose runs take every processor, would wait for seconds.
  bool yields_to_others = false;
};

/// Whether a server that listens at `host` accepts a request whose Host header is `named`, with or
/// without a port. A server at a loopback address accepts the loopback's names and `host` itself.
/// Any other server also accepts this machine's name and every numeric address, because a name
/// server cannot redirect those. A longer name that begins with the machine's belongs to whoever
/// owns its end, so it is not accepted.
bool is_own_host(const std::string& named, const std::string& host);

/// Whether only this machine can reach the address.
bool is_loopback(const std::string& host);

/// Serves from construction to destruction, on its own threads.
class HttpServer {
 public:
  /// Throws Error if the port is taken or the host is not an address of this machine.
  HttpServer(const HttpPlace& place, HttpHandler handler, const HttpLimits& limits = {});
  /// Closes all connections at once, and returns when the calls of the handler under way are over.
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  int port() const;
  /// "http://127.0.0.1:7070/"
  std::string url() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gs
