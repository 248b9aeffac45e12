// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/run_control.h"

#include <spdlog/fmt/fmt.h>

#include <chrono>

#include "gs_app/observers/train_observers.h"
#include "gs_app/view/http/secret.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

// A signal that ends a paused run cannot wake it, so it looks for itself.
constexpr std::chrono::milliseconds kLook{100};

}  // namespace

RunControl::RunControl(const RunFolder& folder, std::function<void(Trainer&)> paused)
    : folder_(folder), paused_(std::move(paused)), token_(new_secret()) {}

HttpAnswer RunControl::answer(const HttpRequest& request) {
  if (!is_same_secret(request.token, token_))
    return http_error(403,
                      "only the page at the address that the program printed controls the run");
  const auto word = request.query.find("do");
  const std::lock_guard lock(mutex_);
  if (is_over_) return http_error(409, "the run is over");
  if (word == request.query.end() || !ask(word->second))
    return http_error(400, "/control needs do=pause, resume, save or stop");
  changed_.notify_all();
  return http_text("{}", "application/json");
}

bool RunControl::ask(const std::string& word) {
  if (word == "pause" || word == "resume")
    is_paused_ = word == "pause";
  else if (word == "save")
    is_saving_ = true;
  else if (word == "stop")
    is_stopping_ = true;
  else
    return false;
  return true;
}

bool RunControl::was_stopped() {
  const std::lock_guard lock(mutex_);
  return is_stopping_;
}

Json RunControl::state() {
  const std::lock_guard lock(mutex_);
  return {{"paused", is_paused_},
          {"saving", is_saving_},
          {"stopping", is_stopping_},
          {"saved", saved_ < 0 ? Json() : Json(saved_)},
          {"trouble", trouble_}};
}

void RunControl::after_step(int step, Trainer& trainer) {
  std::unique_lock lock(mutex_);
  bool has_halted = false;
  while (true) {
    if (is_saving_) {
      lock.unlock();
      save(trainer);
      lock.lock();
    }
    if (is_stopping_) trainer.stop();
    if (!is_paused_ || trainer.stopped_early() || step >= trainer.schedule().steps()) break;
    if (!has_halted) {
      has_halted = true;
      lock.unlock();
      log_info("step {}: paused by the viewer's page, which can resume the run", step);
      if (paused_) paused_(trainer);
      lock.lock();
    }
    changed_.wait_for(lock, kLook);
  }
  if (has_halted) log_info("the run goes on after step {}", step);
}

void RunControl::save(Trainer& trainer) {
  const int step = trainer.step();
  std::string trouble;
  try {
    save_model(folder_, step, trainer);
    log_info("step {}: saved {}", step, folder_.ply(step).string());
  } catch (const Error& error) {
    if (error.code() == ExitCode::out_of_memory) throw;
    log_warning("the model was not saved: {}", error.what());
    trouble = "the model was not saved; the messages of the program say why";
  }
  const std::lock_guard lock(mutex_);
  is_saving_ = false;
  trouble_ = trouble;
  if (trouble.empty()) saved_ = step;
}

void RunControl::after_run(Trainer&) {
  const std::lock_guard lock(mutex_);
  is_over_ = true;
  is_paused_ = is_saving_ = false;
}

}  // namespace gs
