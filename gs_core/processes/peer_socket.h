// SPDX-License-Identifier: Apache-2.0
// Frames over TCP between the processes of one run.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "gs_core/processes/process.h"

namespace gs {

/// Some bytes and their kind, on which the two sides agree.
struct Frame {
  std::uint32_t kind = 0;
  std::vector<std::byte> bytes;
};

/// Thrown where the other side has closed the connection, or neither takes nor sends anything for
/// too long.
struct PeerLost {
  bool is_silent = false;
};

/// One end of a connection. One thread at a time may use it.
class PeerSocket {
 public:
  using Seconds = std::chrono::duration<double>;
  explicit PeerSocket(Descriptor socket);

  /// Sends a frame. Throws PeerLost where the other side takes no byte of it for `patience`.
  void send(std::uint32_t kind, const std::vector<std::byte>& bytes, Seconds patience);
  /// The next frame. Throws PeerLost where no byte of it arrives for `patience`, and where it has
  /// more than `most` bytes: whoever sends it is no part of the run.
  Frame receive(Seconds patience, std::uint64_t most = ~std::uint64_t(0));
  /// Waits until a frame begins to arrive, or the connection is closed. False after `patience`.
  bool has_more(Seconds patience);
  /// The same, however long it takes.
  void wait_for_more();

 private:
  friend class PeerWatch;
  void wait_for(short event, Seconds patience);
  void read_all(void* to, std::size_t bytes, Seconds patience);
  void write_all(const void* from, std::size_t bytes, Seconds patience);

  Descriptor socket_;
};

/// Looks at connections on a thread of its own, while other threads use them or wait for something
/// else. It reads nothing. The sockets must outlive it.
class PeerWatch {
 public:
  /// Calls lost(), once, when one of them is closed by the other side.
  PeerWatch(const std::vector<const PeerSocket*>& peers, std::function<void()> lost);
  ~PeerWatch();

 private:
  void look(const std::vector<int>& sockets, const std::function<void()>& lost);

  std::atomic<bool> has_ended_ = false;
  std::thread thread_;
};

/// Where peers connect.
class PeerListener {
 public:
  enum class Reach { own_machine, all };  // who may connect
  /// Opens a free port. Throws Error.
  explicit PeerListener(Reach reach);

  int port() const { return port_; }
  /// The next connection; nothing after `patience`.
  std::optional<PeerSocket> accept(PeerSocket::Seconds patience);

 private:
  Descriptor socket_;
  int port_ = 0;
};

/// Connects to a listener. Throws Error that names host and port, also where nobody answers for
/// `patience`.
PeerSocket connect_to_peer(const std::string& host, int port, PeerSocket::Seconds patience);

}  // namespace gs
