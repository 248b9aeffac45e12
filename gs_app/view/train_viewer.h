// SPDX-License-Identifier: Apache-2.0
// `gemsplat train --viewer`: a run in the browser while it goes on.
#pragma once

#include "gs_app/run/run_folder.h"
#include "gs_app/view/live_view.h"

namespace gs {

struct ViewerOptions {
  bool is_wanted = false;  // --viewer
  HttpPlace place;         // --viewer-host, --viewer-port
  bool waits = false;      // --viewer-wait
};

/// Serves from construction to destruction.
class TrainViewer {
 public:
  /// Says where it listens. Throws Error where the place is taken. The scene outlives it.
  TrainViewer(const RunFolder& folder, const Scene& scene, const Config& config,
              const ViewerOptions& options);

  /// To be added as the last of the run's observers; metrics and evaluations outlive the run.
  Observer& observer(const MetricsObserver& metrics, const EvaluationObserver& evaluations);

  /// The run is over. With --viewer-wait its model is shown until a signal comes.
  void end(Trainer& trainer, const Evaluation& test);

 private:
  LiveView view_;
  HttpServer server_;
  bool waits_;
};

}  // namespace gs
