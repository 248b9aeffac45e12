// SPDX-License-Identifier: Apache-2.0
#include "gs_app/studio/job_log.h"

#include <fcntl.h>
#include <sys/file.h>

#include <algorithm>

#include "gs_core/error.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

constexpr std::size_t kMostWarnings = 50;
constexpr std::size_t kReadAtOnce = std::size_t(1) << 16;  // bytes
constexpr std::size_t kLongestOutcome = std::size_t(32) << 20;
constexpr std::string_view kViewer = "viewer: ";

std::string text_in(const Json& event, const char* key) {
  const auto at = event.find(key);
  return at != event.end() && at->is_string() ? at->get<std::string>() : std::string();
}

}  // namespace

void JobLog::update() {
  const Descriptor log(::open(file_.c_str(), O_RDONLY | O_CLOEXEC));
  if (log < 0) return;
  std::vector<char> bytes(kReadAtOnce);
  for (ssize_t count = 0; (count = ::pread(log, bytes.data(), bytes.size(), off_t(read_))) > 0;) {
    read_ += std::uint64_t(count);
    for (const char byte : std::string_view(bytes.data(), std::size_t(count))) {
      if (byte != '\n') {
        line_ += byte;
        continue;
      }
      take(line_);
      line_.clear();
    }
  }
}

// Events are objects in one line. The outcome is one in one line, or in several of which the first and
// the last are brackets alone.
void JobLog::take(const std::string& line) {
  const bool begins = line == "{" || line == "[", ends = line == "}" || line == "]";
  if (!outcome_text_.empty() || begins) {
    if (outcome_text_.size() < kLongestOutcome) outcome_text_ += line + "\n";
    if (ends) take_outcome(std::exchange(outcome_text_, ""));
  } else if (line.starts_with('{') || line.starts_with('[')) {
    take_outcome(line);
  } else if (!line.empty() && error.empty()) {
    note = line;  // of a library, or a last word
  }
}

void JobLog::take_outcome(const std::string& text) {
  try {
    Json json = parse_json(file_, text, "start the job again");
    if (json.is_object() && json.contains("event"))
      take_event(json);
    else
      outcome = std::move(json);
  } catch (const Error&) {  // a line that a full disk has cut short
  }
}

void JobLog::take_event(const Json& event) {
  const std::string kind = text_in(event, "event"), text = text_in(event, "text");
  if (kind == "progress") progress = event;
  if (kind == "error" || kind == "stopped") error = text;
  if (kind != "log") return;
  if (text.starts_with(kViewer))
    viewer = text.substr(kViewer.size());
  else
    note = text;
  if (text_in(event, "level") == "warning" && warnings.size() < kMostWarnings)
    warnings.push_back(text);
}

Descriptor new_job_log(const std::filesystem::path& file) {
  std::filesystem::create_directories(file.parent_path());
  Descriptor log = open_log(file);
  ::flock(log, LOCK_EX | LOCK_NB);
  if (::ftruncate(log, 0) != 0)
    throw Error("cannot write " + file.string() + "; is the disk full?");
  return log;
}

bool is_job_alive(const std::filesystem::path& log) {
  const Descriptor file(::open(log.c_str(), O_RDONLY | O_CLOEXEC));
  return file >= 0 && ::flock(file, LOCK_SH | LOCK_NB) != 0;
}

}  // namespace gs
