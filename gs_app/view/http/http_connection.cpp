// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/http/http_connection.h"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <vector>

#include "gs_app/view/http/http_parse.h"

namespace gs {
namespace {

using std::chrono::milliseconds;

constexpr std::size_t kReadBytes = 4096;                   // at a time
constexpr std::size_t kPieceBytes = std::size_t(1) << 16;  // of an answer
constexpr double kDrainSeconds = 2;         // for the peer to close, after its answer
constexpr milliseconds kLongestPoll{1000};  // of one call of poll()

bool would_wait() { return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR; }

}  // namespace

HttpConnection::Time HttpConnection::after(double seconds) {
  const auto now = std::chrono::steady_clock::now();
  return now + std::chrono::duration_cast<Time::duration>(std::chrono::duration<double>(seconds));
}

// False once the time is over.
bool HttpConnection::wait_for(short event) const {
  for (;;) {
    const auto left = std::chrono::ceil<milliseconds>(ends_ - std::chrono::steady_clock::now());
    if (left.count() <= 0) return false;
    pollfd one{socket_, event, 0};
    if (::poll(&one, 1, int(std::min(left, kLongestPoll).count())) > 0) return true;
  }
}

std::string HttpConnection::read_head() {
  std::string received;
  while (wait_for(POLLIN)) {
    char bytes[kReadBytes];
    const ssize_t count = ::recv(socket_, bytes, sizeof bytes, 0);
    if (count < 0 && would_wait()) continue;
    if (count <= 0) return {};
    const std::size_t known = received.size();
    received.append(bytes, std::size_t(count));
    const std::size_t length = head_length(received, known);
    if (length > limits_.head_bytes || (length == 0 && received.size() > limits_.head_bytes)) {
      HttpReply refusal(http_error(431, "the request is too long"));
      return send(refusal), std::string();
    }
    if (length == 0) continue;
    yields_ = Time::max();
    behind_head_ = received.substr(length);
    received.resize(length);
    return received;
  }
  return {};
}

std::optional<std::string> HttpConnection::read_body(std::size_t bytes) {
  std::string body = std::move(behind_head_);
  std::vector<char> space(kPieceBytes);
  for (std::size_t piece_begin = 0; body.size() < bytes;) {
    if (body.size() >= piece_begin) {
      ends_ = after(limits_.piece_seconds);
      yields_ = after(limits_.piece_seconds / 6);
      piece_begin = body.size() + kPieceBytes;
    }
    if (!wait_for(POLLIN)) return std::nullopt;
    const std::size_t wanted = std::min(space.size(), bytes - body.size());
    const ssize_t count = ::recv(socket_, space.data(), wanted, 0);
    if (count < 0 && would_wait()) continue;
    if (count <= 0) return std::nullopt;
    body.append(space.data(), std::size_t(count));
  }
  yields_ = Time::max();
  body.resize(bytes);
  return body;
}

void HttpConnection::send(HttpReply& reply) {
  std::vector<char> space(kPieceBytes);
  std::size_t sent = kPieceBytes;  // since the time of a piece began
  while (!reply.is_sent()) {
    if (sent >= kPieceBytes) {
      ends_ = after(limits_.piece_seconds);
      yields_ = after(limits_.piece_seconds / 6);
      sent = 0;
    }
    const std::string_view piece = reply.next(space);
    if (piece.empty() || !wait_for(POLLOUT)) break;
    const ssize_t count = ::send(socket_, piece.data(), piece.size(), MSG_NOSIGNAL);
    if (count < 0 && would_wait()) continue;
    if (count < 0) break;
    reply.count_sent(std::size_t(count));
    sent += std::size_t(count);
  }
  if (reply.is_sent()) return drain();
  // The rest is of no use to the peer; a plain close would keep it in the system until a slow reader
  // has taken it.
  const linger at_once{1, 0};
  setsockopt(socket_, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
}

// If the socket were closed while bytes of the peer are unread, the system would drop the answer.
void HttpConnection::drain() {
  ::shutdown(socket_, SHUT_WR);
  ends_ = after(kDrainSeconds);
  yields_ = after(0);
  char bytes[kReadBytes];
  while (wait_for(POLLIN)) {
    const ssize_t count = ::recv(socket_, bytes, sizeof bytes, 0);
    if (count == 0 || (count < 0 && !would_wait())) return;
  }
}

void HttpConnection::cut_off() { ::shutdown(socket_, SHUT_RDWR); }

}  // namespace gs
