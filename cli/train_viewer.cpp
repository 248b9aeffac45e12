// SPDX-License-Identifier: Apache-2.0
#include "cli/train_viewer.h"

#include <CLI/CLI.hpp>

#include "cli/options.h"
#include "cli/stop_on_signal.h"
#include "gs_core/log.h"

namespace gs {

void add_viewer_options(CLI::App& verb, ViewerOptions& options) {
  const char* const group = "Viewer";
  verb.add_flag("--viewer", options.is_wanted, "show the run in a browser while it goes on")
      ->group(group);
  add_http_place(verb, options.place, "--viewer-", group);
  verb.add_flag("--viewer-wait", options.waits,
                "go on showing the model after the end, until Ctrl-C")
      ->group(group);
  for (const char* option : {"--viewer-host", "--viewer-port", "--viewer-wait"})
    verb.get_option(option)->needs("--viewer");
}

TrainViewer::TrainViewer(const RunFolder& folder, const Scene& scene, const Config& config,
                         const ViewerOptions& options)
    : view_(folder.root().string(), scene, config),
      server_(options.place,
              [this](const HttpRequest& request) { return view_answer(view_, request); }),
      waits_(options.waits) {
  warn_of_guests(options.place);
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
  log_info("{} shows the model until Ctrl-C", server_.url());
  signal.wait();
}

}  // namespace gs
