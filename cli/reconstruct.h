// SPDX-License-Identifier: Apache-2.0
// How far COLMAP is, on standard error.
#pragma once

#include <memory>

#include "cli/progress_bar.h"
#include "data_loaders/run_colmap.h"

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
