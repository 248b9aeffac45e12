// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/train_viewer.h"

#include <spdlog/fmt/fmt.h>

#include "gs_core/system/log.h"
#include "gs_core/system/processes/signals.h"

namespace gs {

TrainViewer::TrainViewer(const RunFolder& folder, const Scene& scene, const Config& config,
                         const ViewerOptions& options)
    : view_(name_of(folder.root()), scene, config),
      control_(folder, [this](Trainer& trainer) { view_.show_now(trainer); }),
      server_(
          options.place, [this](const HttpRequest& request) { return view_answer(view_, request); },
          HttpLimits{.yields_to_others = true}),
      waits_(options.waits) {
  view_.let_control(control_);
  warn_if_public(options.place, server_.port());
  log_info("viewer: {}#control={}", server_.url(), control_.token());
}

void TrainViewer::watch(Trainer& trainer, const MetricsObserver& metrics,
                        const EvaluationObserver& evaluations) {
  view_.follow(metrics, evaluations);
  trainer.add_observer(view_);
  trainer.add_observer(control_);
}

void TrainViewer::end(Trainer& trainer, const Evaluation& test) {
  if (!waits_) return view_.end({}, test);
  SignalWait signal;
  view_.end(trained_model(trainer), test);
  log_info("{} shows the final model; Ctrl-C ends the server", server_.url());
  signal.wait();
}

void TrainViewer::end_stopped(Trainer& trainer) {
  if (!waits_ || !control_.was_stopped()) return;  // a signal ends the program, too
  SignalWait signal;
  view_.say(fmt::format(
      "The run was stopped after step {} of {}, and its model is saved. gemsplat train --resume "
      "goes on with it.",
      trainer.step(), trainer.schedule().steps()));
  view_.end(trained_model(trainer), {});
  log_info("the run was stopped after step {}; {} shows its model; Ctrl-C ends the server",
           trainer.step(), server_.url());
  signal.wait();
}

}  // namespace gs
