// SPDX-License-Identifier: Apache-2.0
#include "gs_train/ranks/peer_leader.h"

#include <spdlog/fmt/fmt.h>

#include <new>
#include <utility>

#include "gs_core/error.h"
#include "gs_core/processes/packing.h"

namespace gs {

PeerLeader::PeerLeader(std::vector<PeerSocket> peers, PeerRules rules)
    : peers_(std::move(peers)), count_(int(peers_.size()) + 1), rules_(std::move(rules)),
      others_(peers_, PeerSocket::Seconds(rules_.deadline)) {}

PeerLeader::~PeerLeader() {
  if (failure_) return;  // the others end when their connection does
  try {
    others_.send_all(RankFrame::end);
  } catch (const RankFailed&) {
  }
}

std::vector<const PeerSocket*> PeerLeader::connections() const {
  std::vector<const PeerSocket*> all;
  for (const PeerSocket& peer : peers_) all.push_back(&peer);
  return all;
}

void PeerLeader::named(const std::function<void()>& f) {
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

void PeerLeader::set_up() {
  if (!rules_.setup) return;
  others_.send_all(RankFrame::setup, rules_.setup());
  for (int rank = 1; rank < count_; ++rank) others_.receive_from_loading(rank, RankFrame::ready);
  rules_.setup = nullptr;
}

void PeerLeader::for_each_answer(const std::function<void(int, const Message&)>& f) {
  for (int rank = 1; rank < count_; ++rank) f(rank, others_.receive(rank, RankFrame::done));
}

void PeerLeader::wait_for_answers() {
  for_each_answer([](int, const Message&) {});
}

std::string PeerLeader::text_of_loss(const RankFailed& failed) const {
  if (!failed.lost.is_silent) return rules_.why_lost(failed.rank);
  return fmt::format(
      "no sign of life for {:g} s (if the machine is only slow, raise train.rank_deadline)",
      rules_.deadline);
}

void SentLoss::forward_backward(const RenderPass&, const View&, const LossSettings&,
                                Buffer<float>&) {
  GS_CHECK(false);  // ranks compare pictures
}

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

}  // namespace gs
