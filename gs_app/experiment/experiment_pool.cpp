// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/experiment_pool.h"

#include <chrono>
#include <csignal>
#include <map>
#include <thread>

#include "gs_core/error.h"
#include "gs_core/system/processes/process.h"
#include "gs_core/system/processes/signals.h"

namespace gs {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kPollEvery{20};

struct Running {
  const ExperimentRun* run;
  RunSlot slot;
  Clock::time_point start;
};

class Pool {
 public:
  Pool(const std::vector<const ExperimentRun*>& runs, const std::vector<RunSlot>& slots,
       const PoolEvents& events)
      : runs_(runs), free_(slots.rbegin(), slots.rend()), events_(events) {}

  bool work() {
    while (true) {
      pass_signals_on();
      while (signals_.value() == 0 && next_ < runs_.size() && !free_.empty()) start();
      if (running_.empty()) break;
      if (!collect()) {
        events_.waiting(running_.size());
        std::this_thread::sleep_for(kPollEvery);
      }
    }
    return signals_.value() == 0;
  }

 private:
  void start() {
    const ExperimentRun& run = *runs_[next_++];
    const RunSlot slot = free_.back();
    try {
      prepare(run);
      const pid_t child = start_child(train_command(run, slot),
                                      {.output = open_log(run.log()), .saves_on_term = true});
      running_[child] = {&run, slot, Clock::now()};
    } catch (const Error& error) {
      events_.ended(run, {int(error.code()), 0}, 0, error.what());
      return;
    }
    free_.pop_back();
    events_.started(run, slot);
  }

  bool collect() {
    const auto child = ended_child();
    if (!child) return false;
    const auto at = running_.find(child->process);
    if (at == running_.end()) return true;
    const Running ended = at->second;
    running_.erase(at);
    free_.push_back(ended.slot);
    events_.ended(*ended.run, child->end,
                  std::chrono::duration<double>(Clock::now() - ended.start).count(), "");
    return true;
  }

  void pass_signals_on() {
    for (; passed_on_ < signals_.value(); ++passed_on_)
      for (const auto& [process, unused] : running_)
        ::kill(-process, passed_on_ == 0 ? SIGTERM : SIGKILL);
  }

  SignalCount signals_;
  const std::vector<const ExperimentRun*>& runs_;
  std::size_t next_ = 0;
  std::vector<RunSlot> free_;
  std::map<pid_t, Running> running_;
  const PoolEvents& events_;
  int passed_on_ = 0;
};

}  // namespace

bool run_pool(const std::vector<const ExperimentRun*>& runs, const std::vector<RunSlot>& slots,
              const PoolEvents& events) {
  return Pool(runs, slots, events).work();
}

}  // namespace gs
