// SPDX-License-Identifier: Apache-2.0
// The threads of the server. One accepts connections; each of the others serves one at a time, from
// its request to the end of its answer.
#include "gs_app/view/http/http_server.h"

#include <poll.h>
#include <spdlog/fmt/fmt.h>
#include <sys/socket.h>

#include <atomic>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <condition_variable>
#include <list>
#include <mutex>
#include <optional>
#include <semaphore>
#include <thread>

#include "gs_app/view/http/http_connection.h"
#include "gs_app/view/http/http_parse.h"
#include "gs_app/view/http/listen_socket.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/plain_message.h"
#include "gs_core/threads/low_priority.h"
#include "gs_core/threads/parallel.h"
#include "gs_core/threads/start_threads.h"

namespace gs {
namespace {

using std::chrono::milliseconds;

constexpr int kMostAnswers = 8;            // computed at a time
constexpr milliseconds kLongestWait{500};  // for a connection
constexpr milliseconds kPause{50};         // if none can be accepted, or none is over yet

// Whether the request comes from this server's own page or from a person who opens the page, and
// not from another web page.
bool is_wanted(const HttpHead& head, const std::string& host) {
  const std::string from = head.value("sec-fetch-site"), origin = head.value("origin");
  const bool is_foreign = from == "cross-site" || from == "same-site";
  return head.count("host") == 1 && is_own_host(head.value("host"), host) &&
         head.count("origin") <= 1 &&
         (origin.empty() || origin == "http://" + head.value("host")) &&
         (!is_foreign || head.value("sec-fetch-dest") == "document");
}

// Whether a POST is of this server's own page, whose browser says so, or of no browser.
bool is_own_post(const HttpHead& head) {
  const std::string site = head.value("sec-fetch-site");
  return site.empty() || site == "same-origin";
}

// The bytes behind the head; nothing where it does not say how many, or says so twice.
std::optional<std::uint64_t> body_bytes(const HttpHead& head) {
  if (head.count("transfer-encoding") > 0 || head.count("content-length") > 1) return std::nullopt;
  const std::string length = head.value("content-length");
  if (length.empty()) return 0;
  std::uint64_t bytes = 0;
  const char* const last = length.data() + length.size();
  const auto [end, error] = std::from_chars(length.data(), last, bytes);
  return error == std::errc() && end == last ? std::optional(bytes) : std::nullopt;
}

// The reason is for who started the program, not for who asks: it may name folders of this machine.
HttpAnswer internal_error(const std::exception& error) {
  log_warning("the viewer could not answer a request: {}", plain_message(error));
  return http_error(500, "this could not be computed; the messages of the program say why");
}

// While it lives, one answer more is computed; it waits until there may be one.
class Turn {
 public:
  explicit Turn(std::counting_semaphore<>& answers) : answers_(answers) { answers_.acquire(); }
  ~Turn() { answers_.release(); }
  Turn(const Turn&) = delete;

 private:
  std::counting_semaphore<>& answers_;
};

}  // namespace

class HttpServer::Impl {
 public:
  Impl(const HttpPlace& place, HttpHandler handler, const HttpLimits& limits)
      : host_(place.host), limits_(limits), handler_(std::move(handler)),
        listener_(listen_at(place)), port_(port_of(listener_)) {
    start_threads(threads_, limits.connections, [this] { serve_all(); });
    most_connections_ = threads_.size();
    if (!threads_.empty()) start_threads(threads_, 1, [this] { accept_all(); });
    if (threads_.size() > most_connections_) return;
    end();
    throw Error("cannot start the threads of a server; end other programs");
  }

  ~Impl() { end(); }

  int port() const { return port_; }

  std::string url() const {
    const bool is_any = host_ == "0.0.0.0" || host_ == "::";
    const bool is_bare_v6 = host_.find(':') != host_.npos;
    const std::string name = is_any ? "localhost" : is_bare_v6 ? "[" + host_ + "]" : host_;
    return fmt::format("http://{}:{}/", name, port_);
  }

 private:
  void end() {
    {
      const std::lock_guard lock(mutex_);
      ends_ = true;
      for (HttpConnection& connection : served_) connection.cut_off();
    }
    ::shutdown(listener_, SHUT_RDWR);
    accepted_.notify_all();
    closed_.notify_all();
    for (std::thread& thread : threads_) thread.join();
  }

  void accept_all() {
    if (limits_.yields_to_others) lower_priority_once();
    while (!ends_) {
      pollfd one{listener_, POLLIN, 0};
      if (::poll(&one, 1, int(kLongestWait.count())) <= 0) continue;
      try {
        accept_one();
      } catch (const std::exception&) {  // too little memory: others may end meanwhile
        std::this_thread::sleep_for(kPause);
      }
    }
  }

  void accept_one() {
    std::string address;
    Descriptor socket = accept_from(listener_, address);
    if (socket < 0) {
      const bool may_go_on = errno == EAGAIN || errno == EINTR || errno == ECONNABORTED;
      if (!may_go_on) std::this_thread::sleep_for(kPause);  // too few descriptors, or memory
      return;
    }
    std::list<HttpConnection> accepted;
    accepted.emplace_back(std::move(socket), std::move(address), limits_);
    std::unique_lock lock(mutex_);
    while (!ends_ && waiting_.size() + served_.size() >= most_connections_) {
      make_room();
      closed_.wait_for(lock, kPause);
    }
    if (ends_) return;
    waiting_.splice(waiting_.end(), accepted);
    accepted_.notify_one();
  }

  // Cuts off the connection that may make way since the earliest time, if there is one. Its thread
  // closes it. mutex_ is held.
  void make_room() {
    HttpConnection* first = nullptr;
    for (std::list<HttpConnection>* list : {&waiting_, &served_})
      for (HttpConnection& connection : *list)
        if (!first || connection.yields() < first->yields()) first = &connection;
    if (first->yields() <= std::chrono::steady_clock::now()) first->cut_off();
  }

  void serve_all() {
    if (limits_.yields_to_others) lower_priority_once();
    const SerialLoops beside_training;
    for (std::unique_lock lock(mutex_);;) {
      accepted_.wait(lock, [this] { return ends_ || !waiting_.empty(); });
      if (ends_) return;
      const auto connection = waiting_.begin();
      served_.splice(served_.end(), waiting_, connection);
      lock.unlock();
      try {
        serve(*connection);
      } catch (const std::exception&) {  // too little memory: the peer sees the end
      }
      lock.lock();
      served_.erase(connection);
      closed_.notify_one();
    }
  }

  void serve(HttpConnection& connection) {
    const std::string bytes = connection.read_head();
    if (bytes.empty()) return;
    std::optional<HttpHead> head = parse_head(bytes);
    std::optional<HttpAnswer> refusal = http_error(400, "this is no request of HTTP/1.1");
    if (head) {
      head->request.client = connection.address();
      refusal = refusal_of(*head);
      if (!refusal && head->method == "POST") {
        std::optional<std::string> body = connection.read_body(*body_bytes(*head));
        if (!body) return;
        head->request.body = std::move(*body);
      }
    }
    HttpReply reply =
        refusal ? HttpReply(*refusal, !head || head->method != "HEAD") : reply_to(*head);
    connection.send(reply);
  }

  HttpReply reply_to(const HttpHead& head) {
    const bool sends_body = head.method != "HEAD";
    try {
      return HttpReply(answer_to(head), sends_body, head.request.range);
    } catch (const std::exception& error) {  // of the handler, or of a file that cannot be read
      return HttpReply(internal_error(error), sends_body);
    }
  }

  // Before the body of a POST is read.
  std::optional<HttpAnswer> refusal_of(const HttpHead& head) const {
    if (!is_wanted(head, host_))
      return http_error(403, "this server accepts only requests to " + url() +
                                 ", not those of other names or web pages");
    if (head.method == "POST") {
      if (!is_own_post(head))
        return http_error(403, "only this server's own page may ask for this");
      const std::optional<std::uint64_t> bytes = body_bytes(head);
      if (bytes == 0) return std::nullopt;
      if (!bytes || !limits_.may_send_body || !limits_.may_send_body(head.request))
        return http_error(400, "this server takes no request with such a body");
      if (*bytes > limits_.body_bytes) return http_error(413, "this body is too long");
    } else if (head.method != "GET" && head.method != "HEAD") {
      return http_error(404, "there is nothing at this address");
    }
    return std::nullopt;
  }

  HttpAnswer answer_to(const HttpHead& head) {
    const Turn turn(answers_);
    return ends_ ? http_error(500, "the server ends") : handler_(head.request);
  }

  const std::string host_;
  const HttpLimits limits_;
  const HttpHandler handler_;
  Descriptor listener_;
  const int port_;
  std::atomic<bool> ends_ = false;
  std::counting_semaphore<> answers_{kMostAnswers};

  std::mutex mutex_;  // of what follows
  std::condition_variable accepted_, closed_;
  std::list<HttpConnection> waiting_, served_;  // for a thread, and by one

  std::size_t most_connections_ = 0;
  std::vector<std::thread> threads_;
};

HttpServer::HttpServer(const HttpPlace& place, HttpHandler handler, const HttpLimits& limits)
    : impl_(std::make_unique<Impl>(place, std::move(handler), limits)) {}
HttpServer::~HttpServer() = default;

int HttpServer::port() const { return impl_->port(); }
std::string HttpServer::url() const { return impl_->url(); }

}  // namespace gs
