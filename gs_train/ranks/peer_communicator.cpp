// SPDX-License-Identifier: Apache-2.0
#include "gs_train/ranks/peer_communicator.h"

#include <thread>

#include "gs_core/error.h"
#include "gs_core/processes/packing.h"

namespace gs {
namespace {

std::vector<std::byte> packed(const std::vector<Message>& messages) {
  Packer packer;
  for (const Message& message : messages) packer.list(message);
  return packer.take();
}

std::vector<Message> unpacked(const std::vector<std::byte>& bytes, std::size_t count) {
  Unpacker unpacker(bytes);
  std::vector<Message> messages(count);
  for (Message& message : messages) message = unpacker.list<std::byte>();
  return messages;
}

}  // namespace

Frame next_frame(PeerSocket& peer, PeerSocket::Seconds deadline,
                 const std::function<void()>& idle) {
  auto sign = std::chrono::steady_clock::now();
  for (;;) {
    if (peer.has_more(deadline / 8)) {
      Frame frame = peer.receive(deadline);
      if (RankFrame(frame.kind) != RankFrame::alive) return frame;
      sign = std::chrono::steady_clock::now();
    } else if (std::chrono::steady_clock::now() - sign > deadline) {
      throw PeerLost{true};
    }
    idle();
  }
}

LeaderCommunicator::LeaderCommunicator(std::vector<PeerSocket>& peers, PeerSocket::Seconds deadline)
    : peers_(peers), deadline_(deadline), signs_(peers.size(), LifeSigns(deadline)),
      heard_(peers.size()), early_(peers.size()) {}

// Every rank sends all its messages to rank 0, which passes them on.
std::vector<Message> LeaderCommunicator::exchange(std::vector<Message> outgoing) {
  const std::size_t count = peers_.size() + 1;
  GS_CHECK(outgoing.size() == count);
  std::vector<std::vector<Message>> sent = {std::move(outgoing)};
  for (int rank = 1; rank < int(count); ++rank)
    sent.push_back(unpacked(receive(rank, RankFrame::exchange), count));
  const auto messages_to = [&](std::size_t rank) {
    std::vector<Message> messages;
    for (std::vector<Message>& of_one : sent) messages.push_back(std::move(of_one[rank]));
    return messages;
  };
  for (std::size_t rank = 1; rank < count; ++rank)
    send(int(rank), RankFrame::exchange, packed(messages_to(rank)));
  return messages_to(0);
}

void LeaderCommunicator::sign_of_life() {
  for (std::size_t i = 0; i < peers_.size(); ++i) try {
      signs_[i].send(peers_[i]);
    } catch (const PeerLost& lost) {
      throw RankFailed{int(i) + 1, {}, lost};
    }
}

void LeaderCommunicator::send(int rank, RankFrame kind, const std::vector<std::byte>& bytes) {
  try {
    peers_[std::size_t(rank - 1)].send(std::uint32_t(kind), bytes, deadline_);
  } catch (const PeerLost& lost) {
    throw RankFailed{rank, {}, lost};
  }
}

void LeaderCommunicator::send_all(RankFrame kind, const std::vector<std::byte>& bytes) {
  for (int rank = 1; rank < count(); ++rank) send(rank, kind, bytes);
}

template <class Next>
std::vector<std::byte> LeaderCommunicator::answer_of(int rank, RankFrame kind, const Next& next) {
  try {
    Frame frame = next();
    if (RankFrame(frame.kind) == RankFrame::failed) throw RankFailed{rank, std::move(frame.bytes)};
    GS_CHECK(RankFrame(frame.kind) == kind);
    return std::move(frame.bytes);
  } catch (const PeerLost& lost) {
    throw RankFailed{rank, {}, lost};
  }
}

std::vector<std::byte> LeaderCommunicator::receive(int rank, RankFrame kind) {
  return answer_of(rank, kind, [&] { return next_answer(rank, [this] { sign_of_life(); }); });
}

std::vector<std::byte> LeaderCommunicator::receive_from_loading(int rank, RankFrame kind) {
  return answer_of(rank, kind, [&] { return next_answer(rank, [] {}); });
}

std::vector<std::byte> LeaderCommunicator::wait_for(int rank, RankFrame kind) {
  if (early_[std::size_t(rank - 1)].empty()) try {
      peers_[std::size_t(rank - 1)].wait_for_more();
    } catch (const PeerLost& lost) {
      throw RankFailed{rank, {}, lost};
    }
  return receive(rank, kind);
}

// Those that are no signs of life.
Frame LeaderCommunicator::next_answer(int rank, const std::function<void()>& idle) {
  std::deque<Frame>& early = early_[std::size_t(rank - 1)];
  if (early.empty()) return next_frame(peers_[std::size_t(rank - 1)], deadline_, idle);
  Frame frame = std::move(early.front());
  early.pop_front();
  return frame;
}

void LeaderCommunicator::begin_watch() {
  heard_.assign(peers_.size(), std::chrono::steady_clock::now());
}

void LeaderCommunicator::keep_watch() {
  for (int rank = 1; rank < count(); ++rank) {
    look_after(rank);
    if (std::chrono::steady_clock::now() - heard_[std::size_t(rank - 1)] > deadline_)
      throw RankFailed{rank, {}, PeerLost{true}};
  }
}

void LeaderCommunicator::find_failure(PeerSocket::Seconds patience) {
  const auto begin = std::chrono::steady_clock::now();
  for (;;) {
    for (int rank = 1; rank < count(); ++rank) look_after(rank);
    if (std::chrono::steady_clock::now() - begin >= patience) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

void LeaderCommunicator::look_after(int rank) {
  PeerSocket& peer = peers_[std::size_t(rank - 1)];
  try {
    while (peer.has_more(PeerSocket::Seconds(0))) {
      Frame frame = peer.receive(deadline_);
      if (RankFrame(frame.kind) == RankFrame::failed)
        throw RankFailed{rank, std::move(frame.bytes)};
      heard_[std::size_t(rank - 1)] = std::chrono::steady_clock::now();
      if (RankFrame(frame.kind) != RankFrame::alive)
        early_[std::size_t(rank - 1)].push_back(std::move(frame));
    }
  } catch (const PeerLost& lost) {
    throw RankFailed{rank, {}, lost};
  }
}

std::vector<Message> FollowerCommunicator::exchange(std::vector<Message> outgoing) {
  leader_.send(std::uint32_t(RankFrame::exchange), packed(outgoing), deadline_);
  const Frame frame = next_frame(leader_, deadline_, [] {});
  GS_CHECK(RankFrame(frame.kind) == RankFrame::exchange);
  return unpacked(frame.bytes, std::size_t(count_));
}

}  // namespace gs
