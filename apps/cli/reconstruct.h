// SPDX-License-Identifier: Apache-2.0
// Shows the progress of COLMAP on standard error.
#pragma once

#include <memory>

#include "data_loaders/reconstruct/run_colmap.h"
#include "gs_app/run/progress_bar.h"

namespace gs {

/// A ColmapProgress: one bar for each stage.
class ColmapBar {
 public:
  explicit ColmapBar(bool enabled) : enabled_(enabled) {}
  void operator()(ColmapStage stage, std::int64_t done, std::int64_t total);

 private:
  const char* unit() const;

  bool enabled_;
  ColmapStage stage_{};
  std::int64_t total_ = 0;
  std::shared_ptr<ProgressBar> bar_;
};

}  // namespace gs
