// SPDX-License-Identifier: Apache-2.0
// Ranks as processes: what they say to each other, and the two sides of it. Rank 0 is the run; the
// others are connected to it alone, and do what it asks.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "gs_core/processes/peer_socket.h"
#include "gs_core/scene.h"
#include "gs_train/photometric/photometric_model.h"
#include "gs_train/ranks/rank_crew.h"

namespace gs {

/// The kinds of frames. Rank 0 asks: use, deal, step, count, gather, end. A rank answers: done,
/// or failed. Both send during a step: exchange, alive. Ranks on GPUs exchange rows, splats and
/// gradients among themselves (cuda/ranks), and answer only where it is said below.
enum class RankFrame : std::uint32_t {
  hello,  // of gs_app/ranks, before a crew is made: hello, setup, ready
  setup,
  ready,
  use,       // names of loss and photometric model
  deal,      // a shard
  step,      // StepOrder
  count,     // of numbers that are not finite
  gather,    // the rows of the shard
  photos,    // GPUs: the bytes of photos that a GPU may hold; answered
  link,      // GPUs: how they are linked; answered
  finish,    // GPUs: wait for all steps
  loss,      // GPUs, to one rank: that of its last photo; answered
  release,   // GPUs: buffers, and whether shards are in use
  end,       // of the run
  done,      // the answer to all of these but `end`
  failed,    // exit code and message
  exchange,  // messages of a Communicator
  alive,
};

/// An error as the frame `failed`, for rank 0.
std::vector<std::byte> failure_message(const Error& error);
/// Throws it as "rank 2: ...".
[[noreturn]] void throw_failure(int rank, const std::vector<std::byte>& message);

/// How rank 0 and the processes of the other ranks belong together.
struct PeerRules {
  double deadline = 30;  // seconds without a sign of life after which a rank has hung
  /// Why the connection to a rank was lost, for a sentence that begins with its number.
  std::function<std::string(int rank)> why_lost;
  /// The message `setup`, when the views are announced for the first time. A rank answers `ready`,
  /// however long that takes, and shows signs of life (`alive`) until then. Null: the ranks have
  /// their views already.
  std::function<std::vector<std::byte>()> setup = {};
};

/// The crew of rank 0, which is a rank itself, and of the processes behind `peers`: those of ranks
/// 1, 2 and so on. A rank that throws, ends or hangs ends the run: step() and everything after it
/// throws Error that names it. That holds for memory that runs out, too.
std::unique_ptr<RankCrew> make_peer_crew(std::vector<PeerSocket> peers, PeerRules rules);

/// Answers frames of rank 0 until answer(frame) is false. Tells rank 0 what goes wrong, and throws
/// it again. Calls idle(), which may throw, about eight times within a deadline while no frame
/// comes; with null it waits for the next frame, however long that takes.
void answer_leader(PeerSocket& leader, double deadline,
                   const std::function<bool(const Frame&)>& answer,
                   const std::function<void()>& idle = nullptr);

/// The work of another rank: returns when rank 0 ends the run. Throws PeerLost where rank 0 was
/// lost, and, after it has told rank 0, what else went wrong.
///
/// views   the same as rank 0 has
void work_as_rank(PeerSocket& leader, int rank, int count, double deadline,
                  const std::vector<View>& views, const PhotometricConfig& photometric);

}  // namespace gs
