// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/http/http_server.h"

#include <httplib.h>
#include <spdlog/fmt/fmt.h>

#include <atomic>
#include <chrono>
#include <fstream>
#include <thread>

#include "gs_core/error.h"
#include "gs_core/low_priority.h"
#include "gs_core/parallel.h"

namespace gs {
namespace {

constexpr int kPortsTried = 100;
constexpr int kKeepAliveSeconds = 1;  // also how long the server's end waits for an idle browser
constexpr int kWriteSeconds = 1;      // timeout of one piece
// Timeouts in a row: a browser that is decoding does not read for a while.
constexpr int kPauses = 30;
constexpr std::size_t kPieceBytes = std::size_t(1) << 16;
constexpr std::size_t kMostBodyBytes = 1024;  // of a request; ours have no body

// Unlike the library's default, this leaves out SO_REUSEPORT, with which two servers could share a
// port. FD_CLOEXEC keeps child processes from inheriting the socket.
void set_socket_options(socket_t socket) {
  const int yes = 1;
  setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  fcntl(socket, F_SETFD, FD_CLOEXEC);
}

// Whether the reader accepts more before it times out or the server ends.
bool waits_for_reader(httplib::DataSink& sink, const std::atomic<bool>& ends) {
  for (int i = 0; i < kPauses && !ends; ++i)
    if (sink.is_writable()) return true;
  return false;
}

// The body is sent in pieces, because the library would compress a whole one, which takes longer
// than sending it locally.
void set_body(httplib::Response& response, const std::shared_ptr<const std::string>& body,
              const std::string& type, const std::atomic<bool>& ends) {
  if (body->empty()) return response.set_content("", type);
  response.set_content_provider(
      body->size(), type,
      [body, &ends](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
        return waits_for_reader(sink, ends) &&
               sink.write(body->data() + offset, std::min(length, kPieceBytes));
      });
}

void set_file(httplib::Response& response, const std::filesystem::path& path,
              const std::string& type, const std::atomic<bool>& ends) {
  const auto file = std::make_shared<std::ifstream>(path, std::ios::binary);
  std::error_code error;
  const std::uintmax_t bytes = std::filesystem::file_size(path, error);
  if (!*file || error) throw Error("cannot read " + path.string() + "; has it been moved?");
  if (bytes == 0) return response.set_content("", type);
  const auto piece = std::make_shared<std::string>();
  response.set_content_provider(
      std::size_t(bytes), type,
      [file, piece, &ends](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
        piece->resize(std::min(length, kPieceBytes));
        file->seekg(std::streamoff(offset));
        return file->read(piece->data(), std::streamsize(piece->size())) &&
               waits_for_reader(sink, ends) && sink.write(piece->data(), piece->size());
      });
}

void set_answer(httplib::Response& response, const HttpAnswer& answer,
                const std::atomic<bool>& ends) {
  response.status = answer.status;
  for (const auto& [name, value] : answer.headers) response.set_header(name, value);
  if (!answer.file.empty()) return set_file(response, answer.file, answer.type, ends);
  if (answer.body) set_body(response, answer.body, answer.type, ends);
}

HttpRequest request_of(const httplib::Request& request) {
  HttpRequest result{request.path, {}, request.remote_addr};
  for (const auto& [name, value] : request.params) result.query.insert_or_assign(name, value);
  return result;
}

// Whether the request comes from this server's own page or from a person who opens the page, and
// not from another web page.
bool is_wanted(const httplib::Request& request, const std::string& host) {
  const std::string from = request.get_header_value("Sec-Fetch-Site");
  const bool is_foreign = from == "cross-site" || from == "same-site";
  return request.get_header_value_count("Host") == 1 &&
         is_own_host(request.get_header_value("Host"), host) &&
         (!is_foreign || request.get_header_value("Sec-Fetch-Dest") == "document");
}

}  // namespace

struct HttpServer::Impl {
  Impl(const HttpPlace& place, HttpHandler answers)
      : host(place.host), handler(std::move(answers)) {
    server.set_socket_options(set_socket_options);
    server.set_tcp_nodelay(true);
    server.set_keep_alive_timeout(kKeepAliveSeconds);
    // The body of a refused request is not parsed as another request.
    server.set_keep_alive_max_count(1);
    server.set_payload_max_length(kMostBodyBytes);
    server.set_write_timeout(kWriteSeconds);
    server.set_default_headers({{"Cache-Control", "no-store"},
                                {"X-Content-Type-Options", "nosniff"},
                                {"X-Frame-Options", "DENY"},
                                {"Cross-Origin-Resource-Policy", "same-origin"}});
    server.set_pre_routing_handler([this](const auto& request, auto& response) {
      lower_priority_once();
      thread_local const SerialLoops beside_training;
      if (!is_wanted(request, host))
        set_answer(response,
                   http_error(403, "this server accepts only requests to " + url() +
                                       ", not those of other names or web pages"),
                   ends);
      else if (request.method != "GET" && request.method != "HEAD")  // before its body is read
        set_answer(response, http_error(404, "there is nothing at this address"), ends);
      else
        return httplib::Server::HandlerResponse::Unhandled;
      return httplib::Server::HandlerResponse::Handled;
    });
    server.Get(".*", [this](const auto& request, auto& response) { answer(request, response); });
    bind(place);
  }

  void answer(const httplib::Request& request, httplib::Response& response) {
    try {
      set_answer(response, handler(request_of(request)), ends);
    } catch (const std::exception& error) {
      set_answer(response, http_error(500, printable(error.what())), ends);
    }
  }

  void bind(const HttpPlace& place) {
    if (place.port == 0) {
      port = server.bind_to_any_port(host);
    } else {
      const int first = place.port < 0 ? kFirstPort : place.port;
      const int last = place.port < 0 ? kFirstPort + kPortsTried - 1 : place.port;
      for (int tried = first; tried <= last && port <= 0; ++tried)
        if (server.bind_to_port(host, tried)) port = tried;
    }
    if (port <= 0)
      throw Error(
          fmt::format("cannot listen at {}{}: the port is taken, or this machine does not have the "
                      "address; give another --port (0: any) or --host",
                      host, place.port > 0 ? fmt::format(":{}", place.port) : ""));
  }

  void start() {
    thread = std::thread([this] {
      try {
        server.listen_after_bind();
      } catch (const std::exception&) {  // the system allows no more threads
      }
      is_over = true;
    });
    while (!server.is_running() && !is_over)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    if (!is_over) return;
    thread.join();
    throw Error("cannot start the threads of a server; end other programs");
  }

  std::string url() const {
    const bool is_any = host == "0.0.0.0" || host == "::";
    const bool is_bare_v6 = host.find(':') != host.npos;
    const std::string name = is_any ? "localhost" : is_bare_v6 ? "[" + host + "]" : host;
    return fmt::format("http://{}:{}/", name, port);
  }

  std::string host;
  HttpHandler handler;
  httplib::Server server;
  int port = 0;
  std::atomic<bool> ends = false, is_over = false;
  std::thread thread;
};

HttpServer::HttpServer(const HttpPlace& place, HttpHandler handler)
    : impl_(std::make_unique<Impl>(place, std::move(handler))) {
  impl_->start();
}

HttpServer::~HttpServer() {
  impl_->ends = true;
  impl_->server.stop();
  impl_->thread.join();
}

int HttpServer::port() const { return impl_->port; }
std::string HttpServer::url() const { return impl_->url(); }

bool can_serve() { return true; }
std::string cannot_serve() { return {}; }

}  // namespace gs
