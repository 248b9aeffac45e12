// SPDX-License-Identifier: Apache-2.0
// What the page may ask of a run that trains: to pause, to go on, to save its model, to stop.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>

#include "gs_app/run/run_folder.h"
#include "gs_app/view/http/http_server.h"
#include "gs_core/system/text/json.h"
#include "gs_train/loop/trainer.h"

namespace gs {

/// Add it as an observer of the run, behind the LiveView. Requests come from the server's threads,
/// and are carried out between two steps by the thread that trains; it waits there while the run is
/// paused. What is learned is the same to the last bit.
class RunControl final : public Observer {
 public:
  /// `paused` is called when the run has come to a halt.
  explicit RunControl(const RunFolder& folder, std::function<void(Trainer&)> paused = {});

  /// The secret of those who may ask: 32 hexadecimal digits that nobody can guess.
  const std::string& token() const { return token_; }
  /// The answer to POST /control?do=pause, resume, save or stop. 403 without the token, 400 for
  /// other words, 409 when the run is over.
  HttpAnswer answer(const HttpRequest& request);
  /// Whether a page has asked to stop the run.
  bool was_stopped();
  /// {"paused": bool, "saving": bool, "stopping": bool, "saved": step or null, "trouble": text}
  Json state();

  void after_step(int step, Trainer& trainer) override;
  void after_run(Trainer& trainer) override;

 private:
  bool ask(const std::string& word);  // mutex_ is held
  void save(Trainer& trainer);

  const RunFolder folder_;
  const std::function<void(Trainer&)> paused_;
  const std::string token_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool is_paused_ = false, is_saving_ = false, is_stopping_ = false, is_over_ = false;
  int saved_ = -1;  // the step whose model was saved last; -1: none
  std::string trouble_;
};

}  // namespace gs
