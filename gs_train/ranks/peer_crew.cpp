// SPDX-License-Identifier: Apache-2.0
// Rank 0 of a run on the CPU whose ranks are processes.
#include "gs_core/error.h"
#include "gs_core/processes/packing.h"
#include "gs_train/ranks/peer_leader.h"
#include "gs_train/ranks/rank_backend.h"
#include "gs_train/ranks/shards.h"

namespace gs {
namespace {

class PeerCrew final : public RankCrew {
 public:
  PeerCrew(std::vector<PeerSocket> peers, PeerRules rules)
      : leader_(std::move(peers), std::move(rules)), others_(leader_.others()) {}

  int count() const override { return leader_.count(); }
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
    leader_.named([&] { leader_.set_up(); });
    send_what_to_use();
  }

  void deal(const TrainingModel& model, const Deal& deal) override {
    deal_ = deal;
    std::vector<TrainingModel> shards;
    deal_out(model, deal, shards);
    leader_.named([&] {
      for (int rank = 1; rank < count(); ++rank)
        others_.send(rank, RankFrame::deal, message_of(deal, shards[std::size_t(rank)]));
      leader_.wait_for_answers();
    });
    shard_ = std::move(shards.front());
  }

  void step(const StepOrder& order) override {
    GS_CHECK(views_);
    leader_.named([&] {
      others_.send_all(RankFrame::step, message_of(order, *views_));
      const RankStep now{&others_, deal_, {order.photos.data(), order.photos.size()}};
      backend_.step(now, shard_, order.loss, order.update, order.density);
      const std::size_t drawer = (order.photos.size() - 1) % std::size_t(count());
      if (drawer == 0) loss_.set(backend_.loss().value());
      leader_.for_each_answer([&](int rank, const Message& answer) {
        if (std::size_t(rank) == drawer) loss_.set(Unpacker(answer).value<double>());
      });
    });
  }

  Loss& loss() override { return loss_; }
  const TrainingModel& first_shard() const override { return shard_; }

  void gather(TrainingModel& model) override {
    leader_.named([&] {
      others_.send_all(RankFrame::gather);
      auto shards = std::vector<TrainingModel>(std::size_t(count()));
      leader_.for_each_answer([&](int rank, const Message& rows) {
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
    leader_.named([&] {
      others_.send_all(RankFrame::count);
      leader_.for_each_answer(
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
    leader_.named([&] {
      others_.send_all(RankFrame::use, message);
      leader_.wait_for_answers();
    });
  }

  PeerLeader leader_;
  LeaderCommunicator& others_;
  RankBackend backend_;
  SentLoss loss_;
  std::string loss_kind_ = "l1_ssim", photometric_ = kNoPhotometricModel;
  const std::vector<View>* views_ = nullptr;
  Deal deal_;
  TrainingModel shard_;
};

}  // namespace

std::unique_ptr<RankCrew> make_peer_crew(std::vector<PeerSocket> peers, PeerRules rules) {
  return std::make_unique<PeerCrew>(std::move(peers), std::move(rules));
}

}  // namespace gs
