// SPDX-License-Identifier: Apache-2.0
// `gemsplat train --viewer` shows a run in the browser while it trains. A TrainViewer joins the
// parts that this takes: a LiveView that observes the run, a RunControl for what the page asks of
// it, an HTTP server, and the wait for a signal at the end (--viewer-wait).
#pragma once

#include "gs_app/run/run_folder.h"
#include "gs_app/view/live_view.h"

namespace gs {

struct ViewerOptions {
  bool is_wanted = false;  // --viewer
  HttpPlace place;         // --viewer-host, --viewer-port
  bool waits = false;      // --viewer-wait: show the final model until a signal comes
};

/// Serves the run from construction to destruction.
class TrainViewer {
 public:
  /// Logs the address. Throws Error if the port is taken. The scene must outlive this.
  TrainViewer(const RunFolder& folder, const Scene& scene, const Config& config,
              const ViewerOptions& options);

  /// Adds its observers, which must be the last ones of the run. `metrics` and `evaluations` must
  /// outlive the run.
  void watch(Trainer& trainer, const MetricsObserver& metrics,
             const EvaluationObserver& evaluations);

  /// Ends the run. With --viewer-wait, shows its model and returns when a signal has come.
  void end(Trainer& trainer, const Evaluation& test);
  /// The same for a run that stopped early. Returns at once where a signal has stopped it.
  void end_stopped(Trainer& trainer);

 private:
  LiveView view_;
  RunControl control_;
  HttpServer server_;
  bool waits_;
};

}  // namespace gs
