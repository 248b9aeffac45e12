// SPDX-License-Identifier: Apache-2.0
// Rank 0's side of ranks that are processes with a GPU each: the orders over TCP, and the link over
// which GPUs send each other the rest.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <utility>

#include "cuda/ranks/device_link.h"
#include "gs_core/processes/packing.h"
#include "gs_train/ranks/peer_leader.h"

namespace gs::cuda {

class GpuPeers {
 public:
  GpuPeers(std::vector<PeerSocket> peers, PeerRules rules, std::unique_ptr<DeviceLinks> links)
      : links_(std::move(links)), leader_(std::move(peers), std::move(rules)) {}
  ~GpuPeers() { watch_.reset(); }

  int count() const { return leader_.count(); }

  /// As PeerLeader::named(). Where a rank fails, the link is given up first.
  template <class F>
  void named(F&& f) {
    leader_.named([&] {
      leader_.others().begin_watch();
      is_watching_ = true;
      try {
        f();
        is_watching_ = false;
      } catch (const RankFailed&) {
        give_up();
        throw;
      } catch (const LinkLost&) {
        give_up();
        leader_.others().find_failure(PeerSocket::Seconds(3));
        throw Error("the link between the GPUs was lost");
      } catch (...) {
        give_up();
        leader_.others().find_failure(PeerSocket::Seconds(0));  // which may be the cause
        throw;
      }
    });
  }

  // Within named():
  /// Lets the others load the scene, and connects the GPUs, this one being `device`. The link lives
  /// as long as this.
  DeviceLink& connect(int device) {
    leader_.set_up();
    const std::vector<std::byte> invitation = links_->invitation();
    send_all(RankFrame::link, invitation);
    leader_.others().begin_watch();
    link_ = links_->connect(device, 0, count(), invitation, [this] { keep_watch(); });
    watch_.emplace(leader_.connections(), [this] { link_->give_up(); });
    wait_for_answers();
    return *link_;
  }
  bool is_connected() const { return link_ != nullptr; }
  /// Looks after the link and the other ranks. Outside of named() it does nothing: they owe rank 0
  /// no sign of life there.
  void keep_watch() {
    if (!is_watching_) return;
    if (link_) link_->check();
    leader_.others().keep_watch();
  }
  void send_all(RankFrame kind, const std::vector<std::byte>& bytes = {}) {
    leader_.others().send_all(kind, bytes);
  }
  void wait_for_answers() { leader_.wait_for_answers(); }
  /// The same, however long it takes.
  void wait_long_for_answers() {
    for (int rank = 1; rank < count(); ++rank) leader_.others().wait_for(rank, RankFrame::done);
  }
  double loss_of(int rank) {
    leader_.others().send(rank, RankFrame::loss, {});
    return Unpacker(leader_.others().receive(rank, RankFrame::done)).value<double>();
  }

 private:
  void give_up() {
    is_watching_ = false;
    watch_.reset();  // before the connections close
    if (link_) link_->give_up();
  }

  const std::unique_ptr<DeviceLinks> links_;
  std::unique_ptr<DeviceLink> link_;
  PeerLeader leader_;  // the others end before the link does
  std::optional<PeerWatch> watch_;
  bool is_watching_ = false;
};

}  // namespace gs::cuda
