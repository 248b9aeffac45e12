// SPDX-License-Identifier: Apache-2.0
// The loop of the server. One thread waits for all connections at once with poll(), reads the heads
// of requests and sends answers; the threads of HttpWorkers compute the answers.
#include "gs_app/view/http/http_server.h"

#include <poll.h>
#include <spdlog/fmt/fmt.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <deque>
#include <map>
#include <string_view>
#include <system_error>
#include <thread>
#include <unordered_map>

#include "gs_app/view/http/http_connection.h"
#include "gs_app/view/http/http_parse.h"
#include "gs_app/view/http/http_workers.h"
#include "gs_app/view/http/listen_socket.h"
#include "gs_core/error.h"
#include "gs_core/threads/low_priority.h"

namespace gs {
namespace {

using std::chrono::milliseconds;
using State = HttpConnection::State;

constexpr int kLeastConnections = 4, kMostConnections = 2048;
constexpr int kFilesOfAConnection = 2;  // its socket, and the file that is sent
constexpr int kMostWorkers = 8;
constexpr std::size_t kPieceBytes = std::size_t(1) << 16;
constexpr double kDrainSeconds = 2;        // for the peer to close, after its answer
constexpr milliseconds kLongestWait{500};  // of poll(), so that limits of time are looked at
constexpr milliseconds kForEver{-1};
constexpr milliseconds kPause{50};  // if no connection can be accepted
// A browser opens 6 connections to a host. An address with many more is a crowd: the others wait for
// their turn, which costs nothing, and one of them gets it in each interval.
constexpr int kMostServed = 32;
constexpr milliseconds kTurn{100};
constexpr std::chrono::seconds kLongestWaitForTurn{30};
constexpr std::chrono::seconds kStalled{1};        // without progress: another one gets its turn
constexpr std::size_t kFirstPolledConnection = 2;  // after the waker and the listener

// Wakes a thread that waits in poll().
class Waker {
 public:
  Waker() : event_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    if (event_ < 0) throw Error("cannot start a server: too many files are open");
  }
  void wake() const { [[maybe_unused]] const int done = ::eventfd_write(event_, 1); }
  void rest() const {
    eventfd_t count = 0;
    [[maybe_unused]] const int done = ::eventfd_read(event_, &count);
  }
  int descriptor() const { return event_; }

 private:
  Descriptor event_;
};

// Whether the request comes from this server's own page or from a person who opens the page, and
// not from another web page.
bool is_wanted(const HttpHead& head, const std::string& host) {
  const std::string from = head.value("sec-fetch-site");
  const bool is_foreign = from == "cross-site" || from == "same-site";
  return head.count("host") == 1 && is_own_host(head.value("host"), host) &&
         (!is_foreign || head.value("sec-fetch-dest") == "document");
}

// Whether a POST is of this server's own page, whose browser says so, or of no browser.
bool is_own_post(const HttpHead& head) {
  const std::string site = head.value("sec-fetch-site"), origin = head.value("origin");
  return (site.empty() || site == "same-origin") && head.count("origin") <= 1 &&
         (origin.empty() || origin == "http://" + head.value("host"));
}

bool has_body(const HttpHead& head) {
  const std::string length = head.value("content-length");
  return head.count("transfer-encoding") > 0 || head.count("content-length") > 1 ||
         !(length.empty() || length == "0");
}

// Shells mostly give 1024, and allow many more to a program that asks.
void raise_limit_of_files() {
  constexpr rlim_t kEnough = 16'384;
  rlimit files{};
  if (getrlimit(RLIMIT_NOFILE, &files) != 0 || files.rlim_cur >= kEnough) return;
  files.rlim_cur = std::min(files.rlim_max, kEnough);
  setrlimit(RLIMIT_NOFILE, &files);
}

std::size_t most_connections(const HttpLimits& limits) {
  if (limits.connections > 0) return std::size_t(limits.connections);
  raise_limit_of_files();
  return std::size_t(default_connections());
}

}  // namespace

int default_connections() {
  rlimit files{};
  if (getrlimit(RLIMIT_NOFILE, &files) != 0 || files.rlim_cur == RLIM_INFINITY)
    return kMostConnections;
  const rlim_t share = files.rlim_cur / (4 * kFilesOfAConnection);
  return int(std::clamp<rlim_t>(share, kLeastConnections, kMostConnections));
}

class HttpServer::Impl {
 public:
  Impl(const HttpPlace& place, HttpHandler handler, const HttpLimits& limits)
      : host_(place.host), limits_(limits), most_connections_(most_connections(limits)),
        listener_(listen_at(place)), port_(port_of(listener_)), space_(kPieceBytes),
        workers_(std::move(handler),
                 // so that never all connections are under way: these cannot be replaced
                 std::clamp(int(most_connections_) / 2, 1, kMostWorkers),
                 [this] { waker_.wake(); }) {
    polled_.reserve(kFirstPolledConnection + most_connections_);
    try {
      thread_ = std::thread([this] { serve(); });
    } catch (const std::system_error&) {
      throw Error("cannot start the threads of a server; end other programs");
    }
  }

  ~Impl() {
    ends_ = true;
    waker_.wake();
    thread_.join();
  }

  int port() const { return port_; }

  std::string url() const {
    const bool is_any = host_ == "0.0.0.0" || host_ == "::";
    const bool is_bare_v6 = host_.find(':') != host_.npos;
    const std::string name = is_any ? "localhost" : is_bare_v6 ? "[" + host_ + "]" : host_;
    return fmt::format("http://{}:{}/", name, port_);
  }

 private:
  using Connections = std::map<std::uint64_t, HttpConnection>;
  // A connection of a crowd. Nothing is read from it, and no event of it is waited for.
  struct Waiting {
    Descriptor socket;
    std::string address;
    HttpClock::time_point since;
  };

  void serve() {
    lower_priority_once();
    while (!ends_) {
      try {
        wait();
        advance_ready();
        send_results();
        std::erase_if(connections_,
                      [](const auto& entry) { return entry.second.state() == State::closed; });
        if (accepts()) accept_all();
        give_turn();
      } catch (const std::exception&) {  // too little memory: the others may end meanwhile
        std::this_thread::sleep_for(kPause);
      }
    }
    crowd_.clear();
    connections_.clear();  // at once; the workers are waited for afterwards
    listener_.close();
  }

  // Waits for the listener, the workers, any connection, or a limit of time.
  void wait() {
    polled_.clear();
    polled_.push_back({waker_.descriptor(), POLLIN, 0});
    polled_.push_back({accepts() ? int(listener_) : -1, POLLIN, 0});
    for (const auto& [number, connection] : connections_)
      polled_.push_back({connection.socket(), connection.awaited_events(), 0});
    const milliseconds longest = !accepts()             ? kPause
                                 : !crowd_.empty()      ? kTurn
                                 : connections_.empty() ? kForEver
                                                        : kLongestWait;
    if (::poll(polled_.data(), nfds_t(polled_.size()), int(longest.count())) <= 0)
      for (pollfd& one : polled_) one.revents = 0;
    waker_.rest();
  }

  void advance_ready() {
    std::size_t i = kFirstPolledConnection;
    for (auto& [number, connection] : connections_) {
      const short events = polled_[i++].revents;
      if (events == 0) {
        if (is_too_slow(connection)) connection.close();
      } else if (connection.state() == State::working) {  // the peer is gone
        workers_.drop(number);
        connection.close();
      } else {
        advance_or_close(number, connection);
      }
    }
  }

  void send_results() {
    for (HttpResult& result : workers_.results()) {
      const auto found = connections_.find(result.connection);
      if (found == connections_.end() || found->second.state() != State::working) continue;
      found->second.reply(std::move(result.reply));
      advance_or_close(found->first, found->second);
    }
  }

  void advance_or_close(std::uint64_t number, HttpConnection& connection) {
    try {
      advance(number, connection);
    } catch (const std::exception&) {  // too little memory for it
      connection.close();
    }
    if (is_too_slow(connection)) connection.close();
  }

  void advance(std::uint64_t number, HttpConnection& connection) {
    if (connection.state() == State::reading)
      if (const std::string head = connection.read_head(limits_.head_bytes); !head.empty())
        begin_answer(number, connection, head);
    if (connection.state() == State::sending) connection.send_some(space_);
    if (connection.state() == State::draining) connection.drain();
  }

  void begin_answer(std::uint64_t number, HttpConnection& connection, const std::string& bytes) {
    const auto refuse = [&](int status, std::string sentence) {
      connection.reply(std::make_unique<HttpReply>(http_error(status, std::move(sentence))));
    };
    std::optional<HttpHead> head = parse_head(bytes);
    if (!head) return refuse(400, "this is no request of HTTP/1.1");
    if (!is_wanted(*head, host_))
      return refuse(403, "this server accepts only requests to " + url() +
                             ", not those of other names or web pages");
    if (head->method == "POST") {
      if (!is_own_post(*head)) return refuse(403, "only this server's own page may ask for this");
      if (has_body(*head)) return refuse(400, "this server takes no request with a body");
    } else if (head->method != "GET" && head->method != "HEAD") {
      return refuse(404, "there is nothing at this address");
    }
    head->request.client = connection.address();
    connection.begin_work();
    workers_.add({number, std::move(head->request), head->method != "HEAD"});
  }

  bool is_too_slow(const HttpConnection& connection) const {
    const std::chrono::duration<double> time = HttpClock::now() - connection.progress();
    switch (connection.state()) {
      case State::reading: return time.count() > limits_.head_seconds;
      case State::sending: return time.count() > limits_.piece_seconds;
      case State::draining: return time.count() > kDrainSeconds;
      default: return false;
    }
  }

  void accept_all() {
    for (std::size_t i = 0; i < most_connections_; ++i) {  // then the others have their turn
      const bool is_full = connections_.size() + crowd_.size() >= most_connections_;
      if (is_full && !has_waiting_connection()) return;
      if (is_full && !replace_one()) return pause();
      std::string address;
      Descriptor socket = accept_from(listener_, address);
      if (socket < 0) {
        const bool may_go_on = errno == EAGAIN || errno == EINTR || errno == ECONNABORTED;
        return may_go_on ? void() : pause();  // no descriptors or memory: ask again later
      }
      if (has_to_wait(address))
        crowd_.push_back({std::move(socket), std::move(address), HttpClock::now()});
      else
        begin(std::move(socket), std::move(address));
    }
  }

  void begin(Descriptor socket, std::string address) {
    const auto added =
        connections_.try_emplace(++last_number_, std::move(socket), std::move(address)).first;
    advance_or_close(added->first, added->second);  // mostly the request is there already
  }

  std::ptrdiff_t served(const std::string& address) const {
    return std::count_if(connections_.begin(), connections_.end(),
                         [&](const auto& entry) { return entry.second.address() == address; });
  }

  bool has_to_wait(const std::string& address) const {
    return std::any_of(crowd_.rbegin(), crowd_.rend(),
                       [&](const Waiting& one) { return one.address == address; }) ||
           served(address) >= kMostServed;
  }

  // Lets the newest of those that wait begin, so that a person who opens the page does not wait for
  // all that came before.
  void give_turn() {
    const HttpClock::time_point now = HttpClock::now();
    while (!crowd_.empty() && now - crowd_.front().since > kLongestWaitForTurn) crowd_.pop_front();
    if (crowd_.empty() || now < next_turn_ || !has_room_for(crowd_.back().address, now)) return;
    next_turn_ = now + kTurn;
    Waiting newest = std::move(crowd_.back());
    crowd_.pop_back();
    begin(std::move(newest.socket), std::move(newest.address));
  }

  // Whether the address is served by fewer than it may be, if need be without one that makes no
  // progress.
  bool has_room_for(const std::string& address, HttpClock::time_point now) {
    if (served(address) < kMostServed) return true;
    auto slowest = connections_.end();
    for (auto it = connections_.begin(); it != connections_.end(); ++it)
      if (it->second.address() == address && it->second.state() != State::working &&
          (slowest == connections_.end() || it->second.progress() < slowest->second.progress()))
        slowest = it;
    if (slowest == connections_.end() || now - slowest->second.progress() < kStalled) return false;
    connections_.erase(slowest);
    return true;
  }

  bool has_waiting_connection() const {
    pollfd one{listener_, POLLIN, 0};
    return ::poll(&one, 1, 0) > 0;
  }

  bool accepts() const { return HttpClock::now() >= accepts_from_; }

  // Some time without accepting connections; they wait in the system's queue.
  void pause() { accepts_from_ = HttpClock::now() + kPause; }

  // Closes the connection of a crowd that has waited for the longest time. If there is none, closes
  // one of the connections of the address that has the most: first one whose request is not
  // complete or whose answer is sent, then one that takes its answer slowly, then one that waits
  // for a worker; of these the one that made no progress for the longest time. False if all are
  // under way.
  bool replace_one() {
    if (!crowd_.empty()) return crowd_.pop_front(), true;
    const std::string address = busiest_address();
    const auto rank = [](const HttpConnection& connection) {
      const State state = connection.state();
      const int kind = state == State::working ? 2 : state == State::sending ? 1 : 0;
      return std::pair(kind, connection.progress());
    };
    // Mostly the first one can go. In a flood this is done for every connection, so nothing is sorted.
    for (std::vector<std::uint64_t> under_way;;) {
      auto worst = connections_.end();
      for (auto it = connections_.begin(); it != connections_.end(); ++it)
        if (it->second.address() == address &&
            (worst == connections_.end() || rank(it->second) < rank(worst->second)) &&
            std::find(under_way.begin(), under_way.end(), it->first) == under_way.end())
          worst = it;
      if (worst == connections_.end()) return false;
      if (worst->second.state() != State::working || workers_.drop(worst->first)) {
        connections_.erase(worst);
        return true;
      }
      under_way.push_back(worst->first);  // at most one for each worker
    }
  }

  std::string busiest_address() const {
    std::unordered_map<std::string_view, int> counts;
    for (const auto& [number, connection] : connections_) ++counts[connection.address()];
    const auto most = std::max_element(counts.begin(), counts.end(),
                                       [](auto& a, auto& b) { return a.second < b.second; });
    return std::string(most->first);
  }

  const std::string host_;
  const HttpLimits limits_;
  const std::size_t most_connections_;
  Descriptor listener_;
  const int port_;
  const Waker waker_;
  std::atomic<bool> ends_ = false;

  // Of the loop's thread alone:
  Connections connections_;
  std::deque<Waiting> crowd_;  // the newest at the end
  std::uint64_t last_number_ = 0;
  HttpClock::time_point accepts_from_{}, next_turn_{};
  std::vector<pollfd> polled_;
  std::vector<char> space_;  // for a piece of a file

  HttpWorkers workers_;
  std::thread thread_;
};

HttpServer::HttpServer(const HttpPlace& place, HttpHandler handler, const HttpLimits& limits)
    : impl_(std::make_unique<Impl>(place, std::move(handler), limits)) {}
HttpServer::~HttpServer() = default;

int HttpServer::port() const { return impl_->port(); }
std::string HttpServer::url() const { return impl_->url(); }

}  // namespace gs
