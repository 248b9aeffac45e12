// SPDX-License-Identifier: Apache-2.0
// What a job has said so far. Its output goes to a file, which its process holds locked until it
// ends, so that a job is known to run, and how it ended is known, also to a studio that began later.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/system/processes/process.h"
#include "gs_core/system/text/json.h"

namespace gs {

class JobLog {
 public:
  JobLog() = default;
  explicit JobLog(std::filesystem::path file) : file_(std::move(file)) {}

  /// Reads on.
  void update();

  Json progress;                      // the last line of it; null: none yet
  std::vector<std::string> warnings;  // the first of them
  std::string note;                   // the last message
  std::string error;                  // why it failed or stopped
  std::string viewer;                 // "http://127.0.0.1:40123/#control=..." of a run
  Json outcome;                       // what --json printed; null: nothing yet

 private:
  void take(const std::string& line);
  void take_event(const Json& event);
  void take_outcome(const std::string& text);

  std::filesystem::path file_;
  std::uint64_t read_ = 0;  // bytes
  std::string line_, outcome_text_;
};

/// Opens an empty log and locks it; a child that it is given as its output holds the lock from then
/// on. Throws Error.
Descriptor new_job_log(const std::filesystem::path& file);
/// Whether a process holds the lock.
bool is_job_alive(const std::filesystem::path& log);

}  // namespace gs
