// SPDX-License-Identifier: Apache-2.0
// Ranks that talk over sockets as processes do, and are threads of the test.
#pragma once

#include <gtest/gtest.h>
#include <sys/socket.h>

#include <functional>
#include <thread>
#include <utility>
#include <vector>

#include "gs_core/error.h"
#include "gs_train/ranks/peer_ranks.h"

namespace gs {

/// What another rank does.
using PeerWork = std::function<void(PeerSocket& leader, int rank, int count)>;

/// A run's other ranks, each a thread with one end of a socket.
class PeerThreads {
 public:
  PeerThreads(int count, const PeerWork& work) {
    for (int rank = 1; rank < count; ++rank) {
      int ends[2];
      EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, ends), 0);
      peers_.emplace_back(Descriptor(ends[0]));
      threads_.emplace_back([=, end = ends[1]] {
        PeerSocket leader{Descriptor(end)};
        try {
          work(leader, rank, count);
        } catch (const PeerLost&) {
        } catch (const Error&) {  // rank 0 knows
        }
      });
    }
  }
  ~PeerThreads() {
    for (std::thread& thread : threads_) thread.join();
  }
  /// Rank 0's ends. Where nobody takes them, they must be closed before the threads are joined.
  std::vector<PeerSocket> take_peers() { return std::move(peers_); }
  static PeerRules rules(double deadline = 30) {
    PeerRules rules;
    rules.deadline = deadline;
    rules.why_lost = [](int) { return "it is gone"; };
    return rules;
  }

 private:
  std::vector<PeerSocket> peers_;
  std::vector<std::thread> threads_;
};

}  // namespace gs
