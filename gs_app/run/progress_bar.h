// SPDX-License-Identifier: Apache-2.0
// The progress of a long job on standard error. On a terminal it is one line that is redrawn.
// Elsewhere it is a line for every tenth of the job, and at least one every five minutes.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>

#include "gs_app/run/rate_meter.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// How all progress of the program is shown. As JSON it is one object a line on standard error, at
/// most five a second for each bar: {"event": "progress", "done": 370, "total": 600, ...}.
enum class ProgressStyle { bar, json, none };
void set_progress_style(ProgressStyle style);

/// Writes one line to standard error, whole, also where several threads do.
void write_progress_json(const Json& json);
/// Gives the objects to `sink` instead; null: writes them to standard error again.
void set_progress_sink(std::function<void(const Json&)> sink);

/// What is known of a job, for one line.
struct ProgressFigures {
  std::string done;    // "370/600"
  std::string detail;  // "loss 0.0586 | 3,436 Gaussians"; may be empty
  std::string rest;    // "73.5 step/s | 0:03 left"
};

/// A line of at most `columns` characters. Where they do not suffice, the bar shrinks first, then
/// the detail: the time left is always there. `share` of the job is complete, 0 to 1.
std::string progress_line(double share, const ProgressFigures& figures, std::size_t columns);

/// Call due(done) after each unit of work, and draw() only when due() returns true: the detail text
/// is then made only for lines that are shown. Call clear() before other lines are written, such as
/// log messages.
class ProgressBar {
 public:
  /// `enabled` false: nothing is ever due. `done`: what was complete before this process, as in a
  /// resumed run.
  ProgressBar(std::int64_t total, bool enabled, std::int64_t done = 0);
  ~ProgressBar() { clear(); }

  bool due(std::int64_t done);
  /// Shows "done/total", the text `detail`, the rate in `unit` per second, and the time left.
  void draw(std::int64_t done, const std::string& detail, const std::string& unit);
  void clear();
  /// Completed units per second, over the last moments.
  double rate() const { return rate_.rate(); }

 private:
  using Clock = std::chrono::steady_clock;

  std::int64_t total_;
  bool enabled_, is_terminal_;
  bool line_is_drawn_ = false;
  Clock::time_point start_ = Clock::now(), last_time_ = start_;
  std::int64_t next_tenth_;
  RateMeter rate_;
};

}  // namespace gs
