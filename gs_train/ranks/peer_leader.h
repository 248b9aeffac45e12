// SPDX-License-Identifier: Apache-2.0
// Rank 0's side of ranks that are processes, wherever they compute: how it asks them, and the one
// message that ends a run in which a rank fails.
#pragma once

#include <exception>
#include <functional>
#include <vector>

#include "gs_train/loss.h"
#include "gs_train/ranks/peer_communicator.h"
#include "gs_train/ranks/peer_ranks.h"

namespace gs {

class PeerLeader {
 public:
  PeerLeader(std::vector<PeerSocket> peers, PeerRules rules);
  /// Tells the others that the run has ended.
  ~PeerLeader();
  PeerLeader(const PeerLeader&) = delete;
  PeerLeader& operator=(const PeerLeader&) = delete;

  int count() const { return count_; }
  double deadline() const { return rules_.deadline; }
  LeaderCommunicator& others() { return others_; }
  /// The connections to the others.
  std::vector<const PeerSocket*> connections() const;

  /// Calls f(). Where it throws, this throws Error that names the rank which has failed: RankFailed
  /// another one, and anything else rank 0. That failure is the last, since other ranks may be
  /// anywhere in a step: the others end, and every later call throws it again.
  void named(const std::function<void()>& f);

  // Within named():
  /// Sends PeerRules::setup the first time, and waits until all have their views.
  void set_up();
  /// Calls f(rank, answer) for what each of the others has done.
  void for_each_answer(const std::function<void(int rank, const Message& answer)>& f);
  /// Waits until each of the others has done what it was asked for.
  void wait_for_answers();

 private:
  std::string text_of_loss(const RankFailed& failed) const;

  std::vector<PeerSocket> peers_;
  const int count_;
  PeerRules rules_;
  LeaderCommunicator others_;
  std::exception_ptr failure_;
};

/// The loss that the rank has sent which drew the last photo.
class SentLoss final : public Loss {
 public:
  void forward_backward(const RenderPass&, const View&, const LossSettings&,
                        Buffer<float>&) override;
  double value() override { return value_; }
  void set(double value) { value_ = value; }

 private:
  double value_ = 0;
};

}  // namespace gs
