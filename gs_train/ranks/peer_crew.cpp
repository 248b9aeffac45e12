// SPDX-License-Identifier: Apache-2.0
// Rank 0 of a run whose ranks are processes.
#include <spdlog/fmt/fmt.h>

#include <exception>
#include <new>

#include "gs_core/error.h"
#include "gs_core/processes/packing.h"
#include "gs_train/ranks/peer_communicator.h"
#include "gs_train/ranks/peer_ranks.h"
#include "gs_train/ranks/rank_backend.h"
#include "gs_train/ranks/shards.h"

namespace gs {
namespace {

// The loss that the rank has sent which drew the last photo.
class SentLoss final : public Loss {
 public:
  void forward_backward(const RenderPass&, const View&, const LossSettings&,
                        Buffer<float>&) override {
    GS_CHECK(false);  // ranks compare pictures
  }
  double value() override { return value_; }
  void set(double value) { value_ = value; }

 private:
  double value_ = 0;
};

class PeerCrew final : public RankCrew {
 public:
  PeerCrew(std::vector<PeerSocket> peers, PeerRules rules)
      : peers_(std::move(peers)), rules_(std::move(rules)),
        others_(peers_, PeerSocket::Seconds(rules_.deadline)) {}
  ~PeerCrew() override {
    if (failure_) return;  // the others end when their connection does
    try {
      others_.send_all(RankFrame::end);
    } catch (const RankFailed&) {
    }
  }

  int count() const override { return count_; }
  void use_loss(const std::string& kind) override {
    backend_.use_loss(kind);
    loss_kind_ = kind;
    if (views_) send_what_to_use();
  }
  void use_photometric(const std::shared_ptr<const PhotometricModel>& photometric) override {
    backend_.use_photometric(photometric);
    photometric_ = photometric ? photometric->name() : kNoPhotometricModel;
    if (views_) send_what_to_use();
  }
  void announce(const std::vector<View>& views) override {
    views_ = &views;
    if (rules_.setup)
      named([&] {
        others_.send_all(RankFrame::setup, rules_.setup());
        for (int rank = 1; rank < count_; ++rank) others_.wait_for(rank, RankFrame::ready);
      });
    rules_.setup = nullptr;
    send_what_to_use();
  }

  void deal(const TrainingModel& model, const Deal& deal) override {
    deal_ = deal;
    std::vector<TrainingModel> shards;
    deal_out(model, deal, shards);
    named([&] {
      for (int rank = 1; rank < count_; ++rank)
        others_.send(rank, RankFrame::deal, message_of(deal, shards[std::size_t(rank)]));
      for_each_answer([](int, const Message&) {});
    });
    shard_ = std::move(shards.front());
  }

  void step(const StepOrder& order) override {
    GS_CHECK(views_);
    named([&] {
      others_.send_all(RankFrame::step, message_of(order, *views_));
      const RankStep now{&others_, deal_, {order.photos.data(), order.photos.size()}};
      backend_.step(now, shard_, order.loss, order.update, order.density);
      const std::size_t drawer = (order.photos.size() - 1) % std::size_t(count_);
      if (drawer == 0) loss_.set(backend_.loss().value());
      for_each_answer([&](int rank, const Message& answer) {
        if (std::size_t(rank) == drawer) loss_.set(Unpacker(answer).value<double>());
      });
    });
  }

  Loss& loss() override { return loss_; }
  const TrainingModel& first_shard() const override { return shard_; }

  void gather(TrainingModel& model) override {
    named([&] {
      others_.send_all(RankFrame::gather);
      auto shards = std::vector<TrainingModel>(std::size_t(count_));
      for_each_answer([&](int rank, const Message& rows) {
        TrainingModel& shard = shards[std::size_t(rank)];
        take_shape_of(shard_, deal_.count_of(rank), shard);
        take_rows(rows, shard);
      });
      shards.front() = std::move(shard_);
      merge(shards, deal_, model);
      shard_ = std::move(shards.front());
    });
  }

  std::size_t count_not_finite(RowOps& rows) override {
    std::size_t sum = rows.count_not_finite(shard_);
    named([&] {
      others_.send_all(RankFrame::count);
      for_each_answer(
          [&](int, const Message& count) { sum += Unpacker(count).value<std::size_t>(); });
    });
    return sum;
  }

  void release(bool shards_are_in_use) override {
    backend_.release_caches();
    if (!shards_are_in_use) shard_ = TrainingModel();
  }

 private:
  void send_what_to_use() {
    Packer packer;
    packer.text(loss_kind_);
    packer.text(photometric_);
    const std::vector<std::byte> message = packer.take();
    named([&] {
      others_.send_all(RankFrame::use, message);
      for_each_answer([](int, const Message&) {});
    });
  }
  // Calls f(rank, answer) for what each of the others has done.
  template <class F>
  void for_each_answer(F&& f) {
    for (int rank = 1; rank < count_; ++rank) f(rank, others_.receive(rank, RankFrame::done));
  }

  // Calls f(). Any failure names its rank, and is the last, since other ranks may be anywhere in the
  // step.
  template <class F>
  void named(F&& f) {
    if (failure_) std::rethrow_exception(failure_);
    try {
      try {
        f();
      } catch (const RankFailed& failed) {
        if (!failed.message.empty()) throw_failure(failed.rank, failed.message);
        throw Error(
            fmt::format("rank {}: {}, so the run ends; its last checkpoint stands, and "
                        "--resume goes on from it with any number of ranks",
                        failed.rank, text_of_loss(failed)));
      } catch (const Error& error) {
        throw Error(fmt::format("rank 0: {}", error.what()), error.code());
      } catch (const std::bad_alloc&) {
        throw Error("rank 0: out of memory", ExitCode::out_of_memory);
      }
    } catch (...) {
      failure_ = std::current_exception();
      peers_.clear();  // so that the others end
      throw;
    }
  }
  std::string text_of_loss(const RankFailed& failed) const {
    if (!failed.lost.is_silent) return rules_.why_lost(failed.rank);
    return fmt::format(
        "no sign of life for {:g} s (if the machine is only slow, raise train.rank_deadline)",
        rules_.deadline);
  }

  std::vector<PeerSocket> peers_;
  const int count_ = int(peers_.size()) + 1;
  PeerRules rules_;
  LeaderCommunicator others_;
  RankBackend backend_;
  SentLoss loss_;
  std::string loss_kind_ = "l1_ssim", photometric_ = kNoPhotometricModel;
  const std::vector<View>* views_ = nullptr;
  Deal deal_;
  TrainingModel shard_;
  std::exception_ptr failure_;
};

}  // namespace

std::vector<std::byte> failure_message(const Error& error) {
  Packer packer;
  packer.value(int(error.code()));
  packer.text(error.what());
  return packer.take();
}

void throw_failure(int rank, const std::vector<std::byte>& message) {
  Unpacker unpacker(message);
  const auto code = ExitCode(unpacker.value<int>());
  throw Error(fmt::format("rank {}: {}", rank, unpacker.text()), code);
}

std::unique_ptr<RankCrew> make_peer_crew(std::vector<PeerSocket> peers, PeerRules rules) {
  return std::make_unique<PeerCrew>(std::move(peers), std::move(rules));
}

}  // namespace gs
