// SPDX-License-Identifier: Apache-2.0
// One connection of the server, from its first byte to its last. The thread that serves it waits for
// the peer, as long as the limits of the server allow; another thread may cut it off.
#pragma once

#include <atomic>
#include <chrono>
#include <optional>
#include <string>
#include <utility>

#include "gs_app/view/http/http_reply.h"
#include "gs_core/system/processes/process.h"

namespace gs {

class HttpConnection {
 public:
  using Time = std::chrono::steady_clock::time_point;

  HttpConnection(Descriptor socket, std::string address, const HttpLimits& limits)
      : address_(std::move(address)), limits_(limits), socket_(std::move(socket)),
        ends_(after(limits.head_seconds)), yields_(after(0)) {}
  HttpConnection(HttpConnection&&) = delete;

  /// The address of the peer, in digits.
  const std::string& address() const { return address_; }

  /// The head of the peer's request, with the empty line that ends it. "" if the peer is gone, is too
  /// slow, or says more than a head may have; this has been answered.
  std::string read_head();
  /// So many bytes behind the head. Nothing if the peer is gone or too slow.
  std::optional<std::string> read_body(std::size_t bytes);
  /// Sends an answer, and drops what the peer says after its request. Returns early if the peer takes
  /// its answer too slowly.
  void send(HttpReply& reply);

  /// From when on it may be cut off for another one: at once while its request is not complete, or
  /// once its answer is sent; after a sixth of the time for a piece without progress while the answer
  /// is sent; never while it is computed. From any thread.
  Time yields() const { return yields_; }
  /// Ends what read_head() and send() wait for, now and later. From any thread.
  void cut_off();

 private:
  static Time after(double seconds);
  bool wait_for(short event) const;
  void drain();

  const std::string address_;
  const HttpLimits& limits_;
  Descriptor socket_;
  std::string behind_head_;  // what read_head() has received of a body
  Time ends_;                // if the peer does nothing more
  std::atomic<Time> yields_;
};

}  // namespace gs
