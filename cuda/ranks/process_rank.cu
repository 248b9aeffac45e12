// SPDX-License-Identifier: Apache-2.0
// A rank that is a process with a GPU, and not rank 0: it does what rank 0 asks. Orders need no
// answer where the GPUs' own exchange orders the work.
#include <optional>

#include "cuda/backend.h"
#include "cuda/ranks/rank_steps.cuh"
#include "gs_core/processes/packing.h"
#include "gs_train/ranks/peer_communicator.h"

namespace gs::cuda {
namespace {

class Worker {
 public:
  Worker(int device, PeerSocket& leader, int rank, int count, double deadline,
         const std::vector<View>& views, const PhotometricConfig& photometric,
         std::unique_ptr<DeviceLinks> links)
      : leader_(leader), rank_(rank), count_(count), deadline_(deadline), signs_(deadline_),
        views_(views), photometric_(photometric), links_(std::move(links)),
        steps_(device, rank, count) {}
  // Other ranks may be gone: nothing of this one waits for them any more.
  ~Worker() {
    watch_.reset();
    if (link_ && !has_ended_) link_->give_up();
  }

  /// Answers one frame. False where it is the last.
  bool answer(const Frame& frame) {
    switch (RankFrame(frame.kind)) {
      case RankFrame::link: return link(frame.bytes), done(), true;
      case RankFrame::use: return use(frame.bytes), done(), true;
      case RankFrame::photos: {
        const auto bytes = Unpacker(frame.bytes).value<std::uint64_t>();
        return steps_.upload_views(views_, std::size_t(bytes)), done(), true;
      }
      case RankFrame::deal: {
        const DealtShard dealt = dealt_shard_in(frame.bytes);
        return steps_.take_deal(dealt.shard, dealt.deal), true;
      }
      case RankFrame::step:
        return steps_.launch(steps_.shard(), step_order_in(frame.bytes, views_)), true;
      case RankFrame::finish: return steps_.finish(), true;
      case RankFrame::gather: return steps_.give_rows(), true;
      case RankFrame::loss: {
        Packer packer;
        packer.value(steps_.loss_of_last().value());
        return send(packer.take()), true;
      }
      case RankFrame::release:
        return steps_.release_caches(Unpacker(frame.bytes).value<bool>()), true;
      case RankFrame::alive: return true;
      case RankFrame::end: has_ended_ = true; return false;
      default: GS_CHECK(false);
    }
    return false;
  }

  // While no frame comes, the GPU may still wait for that of a rank which hangs.
  void idle() {
    if (link_) link_->check();
    if (!steps_.is_idle()) signs_.send(leader_);
  }

 private:
  void link(const std::vector<std::byte>& invitation) {
    link_ = links_->connect(steps_.device(), rank_, count_, invitation,
                            [this] { signs_.send(leader_); });
    watch_.emplace(std::vector<const PeerSocket*>{&leader_}, [this] { link_->give_up(); });
    steps_.use_link(*link_, [this] {
      link_->check();
      signs_.send(leader_);
    });
  }
  void use(const std::vector<std::byte>& bytes) {
    photometric_.model = Unpacker(bytes).text();
    model_of_light_ = make_photometric_model(photometric_);
    steps_.use_photometric(model_of_light_.get(), "a GPU");
  }
  void done() { send({}); }
  void send(const std::vector<std::byte>& bytes) {
    leader_.send(std::uint32_t(RankFrame::done), bytes, deadline_);
  }

  PeerSocket& leader_;
  const int rank_, count_;
  const PeerSocket::Seconds deadline_;
  LifeSigns signs_;
  const std::vector<View>& views_;
  PhotometricConfig photometric_;
  std::shared_ptr<const PhotometricModel> model_of_light_;
  const std::unique_ptr<DeviceLinks> links_;
  std::unique_ptr<DeviceLink> link_;
  RankSteps steps_;
  std::optional<PeerWatch> watch_;
  bool has_ended_ = false;  // as rank 0 has said
};

}  // namespace

void work_as_gpu_rank(int device, PeerSocket& leader, int rank, int count, double deadline,
                      const std::vector<View>& views, const PhotometricConfig& photometric,
                      std::unique_ptr<DeviceLinks> links) {
  std::optional<Worker> worker;
  try {
    answer_leader(
        leader, deadline,
        [&](const Frame& frame) {
          if (!worker && RankFrame(frame.kind) == RankFrame::end) return false;
          if (!worker)  // here, so that rank 0 is told where it cannot be made
            worker.emplace(device, leader, rank, count, deadline, views, photometric,
                           std::move(links));
          return worker->answer(frame);
        },
        [&] {
          if (worker) worker->idle();
        });
  } catch (const LinkLost&) {
    throw PeerLost{};  // rank 0 knows, or is lost itself
  }
}

}  // namespace gs::cuda
