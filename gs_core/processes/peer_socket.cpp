// SPDX-License-Identifier: Apache-2.0
#include "gs_core/processes/peer_socket.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <spdlog/fmt/fmt.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>
#include <thread>

#include "gs_core/error.h"

namespace gs {
namespace {

using Clock = std::chrono::steady_clock;

struct FrameHead {
  std::uint32_t kind = 0, zero = 0;
  std::uint64_t bytes = 0;
};

// Whether `event`, or the end of the connection, comes within `patience`.
bool comes(int socket, short event, PeerSocket::Seconds patience) {
  const auto end = Clock::now() + std::chrono::duration_cast<Clock::duration>(patience);
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(end - Clock::now()).count();
    pollfd one{socket, event, 0};
    const int found = ::poll(&one, 1, int(std::clamp<std::int64_t>(left, 0, 1'000'000'000)));
    if (found > 0) return true;
    if (found == 0 && Clock::now() >= end) return false;
    if (found < 0 && errno != EINTR) throw PeerLost{};
  }
}

void set_flags(int socket) {
  ::fcntl(socket, F_SETFL, ::fcntl(socket, F_GETFL) | O_NONBLOCK);
  ::fcntl(socket, F_SETFD, FD_CLOEXEC);
  const int yes = 1;  // a frame that others wait for leaves at once
  ::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
}

bool would_wait() { return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR; }

std::string reason() { return std::strerror(errno); }

}  // namespace

PeerSocket::PeerSocket(Descriptor socket) : socket_(std::move(socket)) { set_flags(socket_); }

void PeerSocket::send(std::uint32_t kind, const std::vector<std::byte>& bytes, Seconds patience) {
  const FrameHead head{kind, 0, bytes.size()};
  write_all(&head, sizeof head, patience);
  write_all(bytes.data(), bytes.size(), patience);
}

Frame PeerSocket::receive(Seconds patience, std::uint64_t most) {
  FrameHead head;
  read_all(&head, sizeof head, patience);
  if (head.zero != 0 || head.bytes > most) throw PeerLost{};
  Frame frame{head.kind, std::vector<std::byte>(head.bytes)};
  read_all(frame.bytes.data(), frame.bytes.size(), patience);
  return frame;
}

bool PeerSocket::has_more(Seconds patience) { return comes(socket_, POLLIN, patience); }

void PeerSocket::wait_for_more() {
  while (!has_more(std::chrono::hours(1))) {
  }
}

void PeerSocket::wait_for(short event, Seconds patience) {
  if (!comes(socket_, event, patience)) throw PeerLost{true};
}

void PeerSocket::read_all(void* to, std::size_t bytes, Seconds patience) {
  for (auto* at = static_cast<std::byte*>(to); bytes > 0;) {
    wait_for(POLLIN, patience);
    const ssize_t some = ::recv(socket_, at, bytes, 0);
    if (some == 0 || (some < 0 && !would_wait())) throw PeerLost{};
    if (some < 0) continue;
    at += some;
    bytes -= std::size_t(some);
  }
}

void PeerSocket::write_all(const void* from, std::size_t bytes, Seconds patience) {
  for (auto* at = static_cast<const std::byte*>(from); bytes > 0;) {
    wait_for(POLLOUT, patience);
    const ssize_t some = ::send(socket_, at, bytes, MSG_NOSIGNAL);
    if (some < 0 && !would_wait()) throw PeerLost{};
    if (some < 0) continue;
    at += some;
    bytes -= std::size_t(some);
  }
}

PeerWatch::PeerWatch(const std::vector<const PeerSocket*>& peers, std::function<void()> lost) {
  std::vector<int> sockets;
  for (const PeerSocket* const peer : peers) sockets.push_back(peer->socket_);
  thread_ = std::thread([this, sockets, lost = std::move(lost)] { look(sockets, lost); });
}

PeerWatch::~PeerWatch() {
  has_ended_ = true;
  thread_.join();
}

void PeerWatch::look(const std::vector<int>& sockets, const std::function<void()>& lost) {
  constexpr int kMilliseconds = 20;  // until the end is seen
  std::vector<pollfd> all;
  for (const int socket : sockets) all.push_back({socket, POLLRDHUP, 0});
  while (!has_ended_)
    if (::poll(all.data(), nfds_t(all.size()), kMilliseconds) > 0) return lost();
}

PeerListener::PeerListener(Reach reach) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
  sockaddr_in place{};
  place.sin_family = AF_INET;
  place.sin_addr.s_addr = htonl(reach == Reach::all ? INADDR_ANY : INADDR_LOOPBACK);
  socklen_t size = sizeof place;
  auto* const address = reinterpret_cast<sockaddr*>(&place);
  if (socket_ < 0 || ::bind(socket_, address, size) != 0 || ::listen(socket_, SOMAXCONN) != 0 ||
      ::getsockname(socket_, address, &size) != 0)
    throw Error(fmt::format("no port can be opened for the ranks of this run: {}", reason()));
  set_flags(socket_);
  port_ = ntohs(place.sin_port);
}

std::optional<PeerSocket> PeerListener::accept(PeerSocket::Seconds patience) {
  if (!comes(socket_, POLLIN, patience)) return std::nullopt;
  Descriptor socket(::accept(socket_, nullptr, nullptr));
  if (socket < 0) return std::nullopt;  // it has gone again
  return PeerSocket(std::move(socket));
}

PeerSocket connect_to_peer(const std::string& host, int port, PeerSocket::Seconds patience) {
  const auto fail = [&](const std::string& why) -> Error {
    return Error(
        fmt::format("cannot reach rank 0 at {}:{}: {}; check that it runs, and that the "
                    "machines reach each other",
                    host, port, why));
  };
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (const int error = ::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found))
    throw fail(::gai_strerror(error));
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> owner(found, ::freeaddrinfo);
  const auto end = Clock::now() + std::chrono::duration_cast<Clock::duration>(patience);
  for (;;) {
    Descriptor socket(::socket(AF_INET, SOCK_STREAM, 0));
    if (socket < 0) throw fail(reason());
    if (::connect(socket, found->ai_addr, found->ai_addrlen) == 0)
      return PeerSocket(std::move(socket));
    if (Clock::now() >= end) throw fail(reason());
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
}

}  // namespace gs
