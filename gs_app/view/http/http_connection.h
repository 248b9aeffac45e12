// SPDX-License-Identifier: Apache-2.0
// One connection of the server, from its first byte to its last. It never waits: the server calls it
// when the system says that it can go on.
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "gs_app/view/http/http_reply.h"
#include "gs_core/system/processes/process.h"

namespace gs {

using HttpClock = std::chrono::steady_clock;

class HttpConnection {
 public:
  // It goes through these in order.
  enum class State {
    reading,   // the head of a request
    working,   // an answer is being computed
    sending,   // that answer
    draining,  // the answer is sent; what the peer still says is dropped
    closed,
  };

  HttpConnection(Descriptor socket, std::string address)
      : socket_(std::move(socket)), address_(std::move(address)) {}
  HttpConnection(HttpConnection&&) = delete;
  ~HttpConnection() { close(); }

  State state() const { return state_; }
  int socket() const { return socket_; }
  const std::string& address() const { return address_; }
  /// The events of poll() that it waits for.
  short awaited_events() const;
  /// When it last made progress: entered its state, or had a whole piece of its answer taken. Single
  /// bytes do not count.
  HttpClock::time_point progress() const { return progress_; }

  /// Reads what is there. Returns the request's head once it is complete, and "" before. A head of
  /// more than `most_bytes` is answered with an error.
  std::string read_head(std::size_t most_bytes);
  /// An answer is being computed.
  void begin_work() { enter(State::working); }
  /// Begins to send an answer.
  void reply(std::unique_ptr<HttpReply> reply);
  /// Sends as much as the system takes, but no more than some pieces. `space` may hold one piece.
  void send_some(std::vector<char>& space);
  /// Drops what the peer says.
  void drain();
  void close();

 private:
  void enter(State state);

  Descriptor socket_;
  std::string address_;
  State state_ = State::reading;
  HttpClock::time_point progress_ = HttpClock::now();
  std::string received_;
  std::unique_ptr<HttpReply> reply_;
  std::size_t sent_since_progress_ = 0;
};

}  // namespace gs
