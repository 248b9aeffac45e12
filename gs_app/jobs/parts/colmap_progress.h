// SPDX-License-Identifier: Apache-2.0
// The progress of COLMAP as that of a job.
#pragma once

#include "data_loaders/reconstruct/run_colmap.h"
#include "gs_app/jobs/parts/job.h"

namespace gs {

/// A ColmapProgress: one part for each stage.
class ColmapEvents {
 public:
  explicit ColmapEvents(JobEvents& events) : events_(&events) {}
  void operator()(ColmapStage stage, std::int64_t done, std::int64_t total) {
    const auto [part, unit] = words_of(stage);
    if (done > 0) events_->progress(part, unit, std::size_t(done), std::size_t(total));
  }

 private:
  static std::pair<const char*, const char*> words_of(ColmapStage stage) {
    switch (stage) {
      case ColmapStage::frames: return {"frames taken", "frame"};
      case ColmapStage::copies: return {"photos copied", "photo"};
      case ColmapStage::features: return {"features found", "photo"};
      case ColmapStage::matches: return {"photos matched", "photo"};
      case ColmapStage::model: return {"photos placed", "photo"};
    }
    return {"", ""};
  }

  JobEvents* events_;
};

}  // namespace gs
