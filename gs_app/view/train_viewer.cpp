// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/train_viewer.h"

#include "gs_core/log.h"
#include "gs_core/processes/signals.h"

namespace gs {

TrainViewer::TrainViewer(const RunFolder& folder, const Scene& scene, const Config& config,
                         const ViewerOptions& options)
    : view_(name_of(folder.root()), scene, config),
      server_(options.place,
              [this](const HttpRequest& request) { return view_answer(view_, request); }),
      waits_(options.waits) {
  warn_if_public(options.place);
  log_info("viewer: {}", server_.url());
}

Observer& TrainViewer::observer(const MetricsObserver& metrics,
                                const EvaluationObserver& evaluations) {
  view_.follow(metrics, evaluations);
  return view_;
}

void TrainViewer::end(Trainer& trainer, const Evaluation& test) {
  if (!waits_) return view_.end({}, test);
  SignalWait signal;
  view_.end(trained_model(trainer), test);
  log_info("{} shows the final model; Ctrl-C ends the server", server_.url());
  signal.wait();
}

}  // namespace gs
