// SPDX-License-Identifier: Apache-2.0
// Progress of verbs as bars, or as set_progress_style() says.
#pragma once

#include <optional>

#include "gs_app/jobs/parts/job.h"
#include "gs_app/run/progress_bar.h"

namespace gs {

/// A bar for each part.
class BarEvents : public JobEvents {
 public:
  explicit BarEvents(bool is_shown) : is_shown_(is_shown) {}

  void progress(const std::string& part, const char* unit, std::size_t done,
                std::size_t total) override {
    if (!bar_ || part != part_) bar_.emplace(std::int64_t(total), is_shown_);
    part_ = part;
    if (bar_->due(std::int64_t(done))) bar_->draw(std::int64_t(done), part, unit);
    if (done == total) bar_.reset();  // before the log goes on
  }

 protected:
  void end_bar() { bar_.reset(); }

 private:
  bool is_shown_;
  std::optional<ProgressBar> bar_;
  std::string part_;
};

}  // namespace gs
