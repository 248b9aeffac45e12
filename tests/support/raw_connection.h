// SPDX-License-Identifier: Apache-2.0
// A connection to a server on this machine that says exactly the bytes that a test wants.
#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <string>

#include "gs_core/system/processes/process.h"

namespace gs {

class RawConnection {
 public:
  explicit RawConnection(int port) : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(std::uint16_t(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  }
  /// False once the server has closed the connection.
  bool say(const std::string& bytes) const {
    return ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL) == ssize_t(bytes.size());
  }
  void say_no_more() const { ::shutdown(socket_, SHUT_WR); }
  /// Everything that comes back until the server closes the connection.
  std::string answer() const {
    std::string answer;
    char piece[4096];
    for (ssize_t got = 0; (got = ::recv(socket_, piece, sizeof piece, 0)) > 0;)
      answer.append(piece, std::size_t(got));
    return answer;
  }
  char first_byte() const {
    char byte = 0;
    ::recv(socket_, &byte, 1, 0);
    return byte;
  }
  /// Waits until the server closes the connection, reading nothing. False after a minute.
  bool is_closed_in_time() const {
    pollfd one{socket_, POLLRDHUP, 0};
    return ::poll(&one, 1, 60'000) > 0;
  }

 private:
  Descriptor socket_;
};

inline std::string get_request(const std::string& path) {
  return "GET " + path + " HTTP/1.1\r\nHost: localhost\r\n\r\n";
}

}  // namespace gs
