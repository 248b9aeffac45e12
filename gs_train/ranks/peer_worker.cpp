// SPDX-License-Identifier: Apache-2.0
// A rank that is a process and not rank 0: it does what rank 0 asks.
#include <chrono>
#include <new>

#include "gs_core/error.h"
#include "gs_core/processes/packing.h"
#include "gs_train/ranks/peer_communicator.h"
#include "gs_train/ranks/peer_ranks.h"
#include "gs_train/ranks/rank_backend.h"

namespace gs {
namespace {

class Worker {
 public:
  Worker(PeerSocket& leader, int rank, int count, double deadline, const std::vector<View>& views,
         const PhotometricConfig& photometric)
      : leader_(leader), deadline_(deadline), communicator_(leader, rank, count, deadline_),
        views_(views), photometric_(photometric) {}

  /// Answers one frame. False where it is the last.
  bool answer(const Frame& frame) {
    switch (RankFrame(frame.kind)) {
      case RankFrame::use: return use(frame.bytes), true;
      case RankFrame::deal: dealt_ = dealt_shard_in(frame.bytes); return done(), true;
      case RankFrame::step: return step(frame.bytes), true;
      case RankFrame::gather: return send(rows_of(dealt_.shard)), true;
      case RankFrame::count: {
        Packer packer;
        packer.value(backend_.rows().count_not_finite(dealt_.shard));
        return send(packer.take()), true;
      }
      case RankFrame::alive: return true;
      case RankFrame::end: return false;
      default: GS_CHECK(false);
    }
    return false;
  }

 private:
  void use(const std::vector<std::byte>& bytes) {
    Unpacker unpacker(bytes);
    backend_.use_loss(unpacker.text());
    photometric_.model = unpacker.text();
    backend_.use_photometric(make_photometric_model(photometric_));
    done();
  }
  void step(const std::vector<std::byte>& bytes) {
    const StepOrder order = step_order_in(bytes, views_);
    const RankStep now{&communicator_, dealt_.deal, {order.photos.data(), order.photos.size()}};
    backend_.step(now, dealt_.shard, order.loss, order.update, order.density);
    Packer packer;
    packer.value(backend_.loss().value());
    send(packer.take());
  }
  void done() { send({}); }
  void send(const std::vector<std::byte>& bytes) {
    leader_.send(std::uint32_t(RankFrame::done), bytes, deadline_);
  }

  PeerSocket& leader_;
  const PeerSocket::Seconds deadline_;
  FollowerCommunicator communicator_;
  const std::vector<View>& views_;
  PhotometricConfig photometric_;
  RankBackend backend_;
  DealtShard dealt_;
};

}  // namespace

void answer_leader(PeerSocket& leader, double deadline,
                   const std::function<bool(const Frame&)>& answer,
                   const std::function<void()>& idle) {
  const PeerSocket::Seconds seconds(deadline);
  const auto tell = [&](const Error& error) {
    leader.send(std::uint32_t(RankFrame::failed), failure_message(error), seconds);
  };
  try {
    // Between two steps rank 0 may evaluate for hours. Its end closes the connection.
    do
      while (!leader.has_more(seconds / 8))
        if (idle) idle();
    while (answer(leader.receive(seconds)));
  } catch (const Error& error) {
    tell(error);
    throw;
  } catch (const std::bad_alloc&) {
    const Error error("out of memory", ExitCode::out_of_memory);
    tell(error);
    throw error;
  } catch (const std::logic_error& error) {
    tell(Error(error.what(), ExitCode::bug));
    throw;
  }
}

void work_as_rank(PeerSocket& leader, int rank, int count, double deadline,
                  const std::vector<View>& views, const PhotometricConfig& photometric) {
  Worker worker(leader, rank, count, deadline, views, photometric);
  answer_leader(leader, deadline, [&](const Frame& frame) { return worker.answer(frame); });
}

}  // namespace gs
