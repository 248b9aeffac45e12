// SPDX-License-Identifier: Apache-2.0
#include "gs_app/session/serve_rank.h"

#include <csignal>
#include <new>

#include "data_loaders/scene/scene_hash.h"
#include "gs_app/ranks/rank_processes.h"
#include "gs_app/ranks/shared_scene.h"
#include "gs_app/run/rank_device.h"
#include "gs_app/session/load_run_scene.h"
#include "gs_core/log.h"
#include "gs_core/processes/signals.h"
#include "gs_core/threads/parallel.h"
#include "gs_train/ranks/peer_ranks.h"

namespace gs {
namespace {

using Seconds = PeerSocket::Seconds;

constexpr Seconds kAnHour{3600};

// Rank 0 reconstructs and reads its scene first, which may take hours.
Frame wait_for_setup(PeerSocket& leader) {
  leader.wait_for_more();
  Frame frame = leader.receive(kAnHour);
  if (RankFrame(frame.kind) != RankFrame::setup) throw PeerLost{};
  return frame;
}

Scene load(const SharedScene& shared) {
  if (!shared.scene_hash.empty() && scene_hash(shared.config.dataset) != shared.scene_hash)
    throw Error(shared.config.dataset.source +
                " holds other files here than for rank 0; give all ranks the same scene, for "
                "example on a disk that they share");
  Config config = shared.config;
  SessionHooks hooks;
  Scene scene = load_run_scene(config, hooks);
  make_same(scene, shared);
  return scene;
}

void work(PeerSocket& leader, const RankPlace& place) {
  const SharedScene shared = shared_scene_in(wait_for_setup(leader).bytes);
  const TrainConfig& train = shared.config.train;
  set_thread_count(shared.threads);
  std::optional<Scene> scene;
  std::unique_ptr<RankDevice> device;
  try {
    device = make_rank_device(
        train, [&](int first, int visible) { return gpu_of(place, first, visible); });
    scene.emplace(load(shared));
  } catch (const Error& error) {
    leader.send(std::uint32_t(RankFrame::failed), failure_message(error), kAnHour);
    throw;
  }
  leader.send(std::uint32_t(RankFrame::ready), {}, kAnHour);
  device->work(leader, place.rank, place.count, double(train.rank_deadline), scene->train_views,
               shared.config.photometric);
}

}  // namespace

ExitCode serve_rank(const RankPlace& place) {
  setup_log(Verbosity::quiet);  // rank 0 says what all of them do
  // A signal to all ranks is for rank 0: it saves the run, and then the connection ends.
  for (const int signal : kStopSignals) std::signal(signal, SIG_IGN);
  PeerSocket leader = reach_rank_0(place);
  try {
    work(leader, place);
    return ExitCode::done;
  } catch (const PeerLost&) {
    return ExitCode::bad_data;
  } catch (const Error& error) {
    return error.code();
  } catch (const std::bad_alloc&) {
    return ExitCode::out_of_memory;
  }
}

}  // namespace gs
