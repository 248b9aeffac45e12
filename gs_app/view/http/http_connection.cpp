// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/http/http_connection.h"

#include <poll.h>
#include <sys/socket.h>

#include <cerrno>

#include "gs_app/view/http/http_parse.h"

namespace gs {
namespace {

constexpr std::size_t kReadBytes = 4096;  // at a time
constexpr int kPiecesAtATime = 16;        // sent before other connections have their turn
constexpr int kReadsAtATime = 16;

bool would_wait() { return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR; }

}  // namespace

short HttpConnection::awaited_events() const {
  switch (state_) {
    case State::reading:
    case State::draining: return POLLIN;
    case State::sending: return POLLOUT;
    default: return 0;
  }
}

void HttpConnection::enter(State state) {
  state_ = state;
  progress_ = HttpClock::now();
}

std::string HttpConnection::read_head(std::size_t most_bytes) {
  char bytes[kReadBytes];
  for (int i = 0; i < kReadsAtATime; ++i) {
    const ssize_t count = ::recv(socket_, bytes, sizeof bytes, 0);
    if (count < 0 && would_wait()) return {};
    if (count <= 0) return close(), std::string();
    const std::size_t known = received_.size();
    received_.append(bytes, std::size_t(count));
    const std::size_t length = head_length(received_, known);
    if (length > most_bytes || (length == 0 && received_.size() > most_bytes))
      return reply(std::make_unique<HttpReply>(http_error(431, "the request is too long"))),
             std::string();
    if (length > 0) return received_.substr(0, length);
  }
  return {};
}

void HttpConnection::reply(std::unique_ptr<HttpReply> reply) {
  if (!reply) return close();
  reply_ = std::move(reply);
  received_ = {};
  enter(State::sending);
}

void HttpConnection::send_some(std::vector<char>& space) {
  for (int i = 0; i < kPiecesAtATime && !reply_->is_sent(); ++i) {
    const std::string_view piece = reply_->next(space);
    if (piece.empty()) return close();
    const ssize_t count = ::send(socket_, piece.data(), piece.size(), MSG_NOSIGNAL);
    if (count < 0 && would_wait()) return;
    if (count < 0) return close();
    reply_->count_sent(std::size_t(count));
    sent_since_progress_ += std::size_t(count);
    if (sent_since_progress_ < space.size()) continue;
    progress_ = HttpClock::now();
    sent_since_progress_ = 0;
  }
  if (!reply_->is_sent()) return;
  reply_.reset();
  // If the socket were closed while bytes of the peer are unread, the system would drop the answer.
  ::shutdown(socket_, SHUT_WR);
  enter(State::draining);
}

void HttpConnection::drain() {
  char bytes[kReadBytes];
  for (int i = 0; i < kReadsAtATime; ++i) {
    const ssize_t count = ::recv(socket_, bytes, sizeof bytes, 0);
    if (count < 0 && would_wait()) return;
    if (count <= 0) return close();
  }
}

void HttpConnection::close() {
  // The rest of an answer that is not complete is of no use to the peer; a plain close would keep it
  // in the system until a slow reader has taken it.
  const linger at_once{1, 0};
  if (state_ == State::sending)
    setsockopt(socket_, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
  socket_.close();
  reply_.reset();
  received_ = {};
  state_ = State::closed;
}

}  // namespace gs
