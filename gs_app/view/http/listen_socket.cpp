// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/http/listen_socket.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <spdlog/fmt/fmt.h>
#include <sys/socket.h>

#include <cerrno>
#include <memory>

#include "gs_core/error.h"

namespace gs {
namespace {

constexpr int kPortsTried = 100;
constexpr int kWaitingConnections = 4096;  // in the system, until the server accepts them
// Bytes of a connection that wait in the system for a slow reader. The system's own limit is some
// megabytes, which many connections would multiply.
constexpr int kSendBufferBytes = 1 << 18;

using Addresses = std::unique_ptr<addrinfo, decltype(&freeaddrinfo)>;

void set_option(int socket, int level, int option, int value) {
  setsockopt(socket, level, option, &value, sizeof value);
}

Addresses addresses_of(const std::string& host, int port) {
  addrinfo wanted{}, *found = nullptr;
  wanted.ai_socktype = SOCK_STREAM;
  wanted.ai_flags = AI_PASSIVE | AI_NUMERICSERV;
  if (getaddrinfo(host.c_str(), std::to_string(port).c_str(), &wanted, &found) != 0)
    found = nullptr;
  return {found, freeaddrinfo};
}

// Negative with errno if this address cannot be had.
Descriptor listening(const addrinfo& address) {
  Descriptor socket(::socket(address.ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (socket < 0) return socket;
  // SO_REUSEPORT is left out: with it, two servers could share a port.
  set_option(socket, SOL_SOCKET, SO_REUSEADDR, 1);
  if (address.ai_family == AF_INET6) set_option(socket, IPPROTO_IPV6, IPV6_V6ONLY, 0);
  if (::bind(socket, address.ai_addr, address.ai_addrlen) != 0 ||
      ::listen(socket, kWaitingConnections) != 0) {
    const int error = errno;
    socket.close();
    errno = error;
  }
  return socket;
}

// At the first address of the host that this machine has; negative if there is none, or if another
// program listens there. A browser tries the addresses in the same order: where `localhost` is ::1
// and 127.0.0.1 and another program has ::1, a server at 127.0.0.1 would never be asked.
Descriptor listening(const std::string& host, int port) {
  const Addresses addresses = addresses_of(host, port);
  for (const addrinfo* address = addresses.get(); address; address = address->ai_next) {
    if (Descriptor socket = listening(*address); socket >= 0) return socket;
    if (errno == EADDRINUSE) break;
  }
  return Descriptor(-1);
}

}  // namespace

Descriptor listen_at(const HttpPlace& place) {
  if (place.host.empty())
    throw Error("cannot listen at an empty address; give another --host, such as 127.0.0.1");
  const int first = place.port < 0 ? kFirstPort : place.port;
  const int last = place.port < 0 ? kFirstPort + kPortsTried - 1 : place.port;
  for (int port = first; port <= last; ++port)
    if (Descriptor socket = listening(place.host, port); socket >= 0) return socket;
  throw Error(
      fmt::format("cannot listen at {}{}: the port is taken, or this machine does not have the "
                  "address; give another --port (0: any) or --host",
                  place.host, place.port > 0 ? fmt::format(":{}", place.port) : ""));
}

int port_of(int socket) {
  sockaddr_storage address{};
  socklen_t bytes = sizeof address;
  getsockname(socket, reinterpret_cast<sockaddr*>(&address), &bytes);
  return ntohs(address.ss_family == AF_INET6
                   ? reinterpret_cast<const sockaddr_in6&>(address).sin6_port
                   : reinterpret_cast<const sockaddr_in&>(address).sin_port);
}

Descriptor accept_from(int socket, std::string& address) {
  sockaddr_storage peer{};
  socklen_t bytes = sizeof peer;
  Descriptor connection(
      ::accept4(socket, reinterpret_cast<sockaddr*>(&peer), &bytes, SOCK_CLOEXEC | SOCK_NONBLOCK));
  if (connection < 0) return connection;
  set_option(connection, IPPROTO_TCP, TCP_NODELAY, 1);
  set_option(connection, SOL_SOCKET, SO_SNDBUF, kSendBufferBytes);
  char digits[NI_MAXHOST] = {};
  getnameinfo(reinterpret_cast<const sockaddr*>(&peer), bytes, digits, sizeof digits, nullptr, 0,
              NI_NUMERICHOST);
  address = digits;
  return connection;
}

}  // namespace gs
