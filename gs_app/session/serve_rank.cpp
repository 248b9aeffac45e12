// SPDX-License-Identifier: Apache-2.0
#include "gs_app/session/serve_rank.h"

#include <chrono>
#include <condition_variable>
#include <csignal>
#include <mutex>
#include <new>
#include <system_error>
#include <thread>

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

/// Shows rank 0 signs of life while this rank loads, on a thread of its own: nobody else may use the
/// connection meanwhile. If there is no progress for an hour, such as where a network drive does not
/// answer, the signs end, and with them the run.
class SignsWhileLoading final : public SessionHooks {
 public:
  SignsWhileLoading(PeerSocket& leader, Seconds deadline) : leader_(leader), every_(deadline / 8) {
    try {
      thread_ = std::thread([this] { show_signs(); });
    } catch (const std::system_error& error) {
      throw Error(std::string("no thread can be started: ") + error.what() +
                  "; allow more processes (ulimit -u)");
    }
  }
  ~SignsWhileLoading() override {
    {
      const std::lock_guard lock(mutex_);
      has_ended_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }
  void show_loading(LoadStage, std::size_t, std::size_t) override {
    const std::lock_guard lock(mutex_);
    progress_ = Clock::now();
  }

 private:
  using Clock = std::chrono::steady_clock;
  void show_signs() {
    std::unique_lock lock(mutex_);
    while (!changed_.wait_for(lock, every_, [this] { return has_ended_; })) {
      if (Clock::now() - progress_ > kAnHour) return;
      try {
        leader_.send(std::uint32_t(RankFrame::alive), {}, every_);
      } catch (const PeerLost&) {  // found out by the next message
        return;
      }
    }
  }

  PeerSocket& leader_;
  const Seconds every_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool has_ended_ = false;
  Clock::time_point progress_ = Clock::now();
  std::thread thread_;
};

Scene load(const SharedScene& shared, SessionHooks& hooks) {
  if (!shared.scene_hash.empty() && scene_hash(shared.config.dataset) != shared.scene_hash)
    throw Error(shared.config.dataset.source +
                " holds other files here than for rank 0; give all ranks the same scene, for "
                "example on a disk that they share");
  Config config = shared.config;
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
    SignsWhileLoading signs(leader, Seconds(train.rank_deadline));
    device = make_rank_device(
        train, [&](int first, int visible) { return gpu_of(place, first, visible); });
    scene.emplace(load(shared, signs));
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
