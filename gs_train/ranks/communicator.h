// SPDX-License-Identifier: Apache-2.0
// How ranks talk to each other. All ranks make the same calls in the same order.
#pragma once

#include <cstddef>
#include <vector>

namespace gs {

using Message = std::vector<std::byte>;

/// One rank's way to the others. Where another rank has failed, or has hung for longer than the
/// deadline, every call throws an exception that only whoever runs the ranks catches.
class Communicator {
 public:
  virtual ~Communicator() = default;
  virtual int rank() const = 0;
  virtual int count() const = 0;
  /// Sends message p to rank p, also to this rank itself, and returns the messages to this rank, by
  /// the rank that sent them.
  ///
  /// outgoing   (count()) messages; they may be empty
  virtual std::vector<Message> exchange(std::vector<Message> outgoing) = 0;
  /// Gives every rank the messages of all ranks, in the order of ranks.
  std::vector<Message> all_gather(const Message& mine) {
    return exchange(std::vector<Message>(std::size_t(count()), mine));
  }
  /// Waits until all ranks have called it.
  virtual void barrier() = 0;
  /// Says that this rank is alive. A rank calls it between long pieces of work. Returns without
  /// waiting.
  virtual void sign_of_life() = 0;
};

}  // namespace gs
