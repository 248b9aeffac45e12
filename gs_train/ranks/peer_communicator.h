// SPDX-License-Identifier: Apache-2.0
// Communicators of ranks that are processes: a star with rank 0 in its middle.
#pragma once

#include <chrono>
#include <deque>
#include <functional>
#include <vector>

#include "gs_core/processes/peer_socket.h"
#include "gs_train/ranks/communicator.h"
#include "gs_train/ranks/peer_ranks.h"

namespace gs {

/// Sends signs of life, but not more often than eight times within the deadline.
class LifeSigns {
 public:
  explicit LifeSigns(PeerSocket::Seconds deadline) : deadline_(deadline) {}
  void send(PeerSocket& to) {
    const auto now = std::chrono::steady_clock::now();
    if (now - last_ < deadline_ / 8) return;
    last_ = now;
    to.send(std::uint32_t(RankFrame::alive), {}, deadline_);
  }

 private:
  const PeerSocket::Seconds deadline_;
  std::chrono::steady_clock::time_point last_{};
};

/// The next frame that is no sign of life. Calls idle() while it waits. Throws PeerLost where the
/// other side shows no sign of life within the deadline.
Frame next_frame(PeerSocket& peer, PeerSocket::Seconds deadline, const std::function<void()>& idle);

/// Thrown at rank 0 where another rank has failed, or was lost.
struct RankFailed {
  int rank;
  std::vector<std::byte> message;  // failure_message(); empty if it was lost
  PeerLost lost = {};
};

/// Rank 0.
class LeaderCommunicator final : public Communicator {
 public:
  LeaderCommunicator(std::vector<PeerSocket>& peers, PeerSocket::Seconds deadline);
  int rank() const override { return 0; }
  int count() const override { return int(peers_.size()) + 1; }
  std::vector<Message> exchange(std::vector<Message> outgoing) override;
  void barrier() override { exchange(std::vector<Message>(peers_.size() + 1)); }
  void sign_of_life() override;

  /// To one rank, and to all others. They throw RankFailed.
  void send(int rank, RankFrame kind, const std::vector<std::byte>& bytes);
  void send_all(RankFrame kind, const std::vector<std::byte>& bytes = {});
  /// The next frame of a rank, which must be of this kind.
  std::vector<std::byte> receive(int rank, RankFrame kind);
  /// The same, however long it takes.
  std::vector<std::byte> wait_for(int rank, RankFrame kind);
  /// The same of a rank that shows signs of life while it works, and reads none of ours meanwhile.
  std::vector<std::byte> receive_from_loading(int rank, RankFrame kind);

  /// For ranks that answer nothing for a while, but show signs of life while they work or wait.
  /// begin_watch() counts their silence from now on. keep_watch() throws RankFailed where one has
  /// failed, was lost, or is silent for too long.
  void begin_watch();
  void keep_watch();
  /// Something is wrong: throws RankFailed as soon as a rank says that it has failed, or is lost.
  /// Returns where none does within `patience`.
  void find_failure(PeerSocket::Seconds patience);

 private:
  // Reads what a rank has sent. Answers are kept for receive().
  void look_after(int rank);
  Frame next_answer(int rank, const std::function<void()>& idle);
  template <class Next>
  std::vector<std::byte> answer_of(int rank, RankFrame kind, const Next& next);

  std::vector<PeerSocket>& peers_;  // of rank 1, 2, ...
  const PeerSocket::Seconds deadline_;
  std::vector<LifeSigns> signs_;
  std::vector<std::chrono::steady_clock::time_point> heard_;  // from each, since begin_watch()
  std::vector<std::deque<Frame>> early_;                      // answers that came while it watched
};

/// Another rank.
class FollowerCommunicator final : public Communicator {
 public:
  FollowerCommunicator(PeerSocket& leader, int rank, int count, PeerSocket::Seconds deadline)
      : leader_(leader), rank_(rank), count_(count), deadline_(deadline), signs_(deadline) {}
  int rank() const override { return rank_; }
  int count() const override { return count_; }
  std::vector<Message> exchange(std::vector<Message> outgoing) override;
  void barrier() override { exchange(std::vector<Message>(std::size_t(count_))); }
  void sign_of_life() override { signs_.send(leader_); }

 private:
  PeerSocket& leader_;
  const int rank_, count_;
  const PeerSocket::Seconds deadline_;
  LifeSigns signs_;
};

}  // namespace gs
