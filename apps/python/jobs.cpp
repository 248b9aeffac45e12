// SPDX-License-Identifier: Apache-2.0
#include <pybind11/stl.h>
#include <spdlog/fmt/fmt.h>

#include <csignal>
#include <mutex>

#include "apps/python/devices.h"
#include "apps/python/module.h"
#include "gs_app/jobs/keywords.h"
#include "gs_app/jobs/parts/bar_events.h"
#include "gs_app/jobs/verbs.h"
#include "gs_core/config/text/nearest_word.h"
#include "gs_core/error.h"
#include "gs_core/system/processes/process.h"
#include "gs_core/system/processes/signals.h"

namespace py = pybind11;

namespace gs::python {
namespace {

std::string text_of(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

thread_local bool t_is_telling = false;

/// Gives a verb's events to a function of Python, as objects of --progress json. One at a time.
class PythonEvents final : public BarEvents {
 public:
  explicit PythonEvents(const py::object& function)
      : BarEvents(!function.is_none()), function_(function) {
    current_ = this;
    set_progress_style(function.is_none() ? ProgressStyle::none : ProgressStyle::json);
    if (function.is_none()) return;
    set_progress_sink([this](const Json& event) { tell(event); });
    detail::set_log_sink([](detail::LogLevel level, std::string_view line) {
      const char* const words[] = {"info", "warning", "error"};
      current_->tell({{"event", "log"}, {"level", words[int(level)]}, {"text", line}});
    });
  }
  ~PythonEvents() override {
    detail::set_log_sink(nullptr);
    set_progress_sink(nullptr);
    set_progress_style(ProgressStyle::bar);
  }

  void progress(const std::string& part, const char* unit, std::size_t done,
                std::size_t total) override {
    BarEvents::progress(part, unit, done, total);
    const py::gil_scoped_acquire gil;
    if (PyErr_CheckSignals()) throw py::error_already_set();
    rethrow_failure();
  }
  /// Throws what the function has raised. Where it was called, the work could not be left.
  void rethrow_failure() const {
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  // Work that takes signals ends by one, with its state saved; other work at its next progress.
  void tell(const Json& event) {
    const py::gil_scoped_acquire gil;
    if (failure_) return;
    const struct Telling {
      Telling() { t_is_telling = true; }
      ~Telling() { t_is_telling = false; }
    } telling;
    try {
      function_(py::module_::import("json").attr("loads")(text_of(event)));
    } catch (const py::error_already_set&) {
      failure_ = std::current_exception();
      if (SignalHandlers::are_set()) ::raise(SIGINT);
    }
  }

  static inline PythonEvents* current_ = nullptr;
  const py::object& function_;  // None: nobody listens
  std::exception_ptr failure_;
};

// One job at a time: verbs set the number of threads, signal handlers and the log. Runs without the
// GIL.
Outcome work(VerbCall& call, const py::object& progress) {
  static auto& one_at_a_time = *new std::mutex;
  if (t_is_telling)
    throw UsageError("progress cannot begin another job; begin it when this one has ended");
  const py::gil_scoped_release release;
  const std::scoped_lock lock(one_at_a_time);
  const Work work;
  PythonEvents events(progress);
  try {
    Outcome outcome = call.work(events);
    events.rethrow_failure();
    return outcome;
  } catch (const Error&) {  // such as that it was stopped
    events.rethrow_failure();
    throw;
  }
}

// With the threads of set_threads(), unless the request names their number.
void share_threads(JobSettings& settings) {
  Config config;
  for (const std::string& flag : settings.flags)
    if (flag.starts_with("train.threads=")) apply_setting(config, flag);
  if (config.train.threads > 0)
    set_threads(config.train.threads);
  else if (threads_asked_for() > 0)
    settings.flags.push_back(fmt::format("train.threads={}", threads_asked_for()));
}

// The JSON of the outcome, and what has failed.
py::tuple run_job(const std::string& verb, const std::string& sub_verb, const std::string& values,
                  const py::object& progress) {
  const std::unique_ptr<VerbCall> call = call_of(verb);
  JobSettings& settings = call->options().settings;
  settings.quiet = progress.is_none();
  take_keywords(call->options(), Json::parse(values), sub_verb);
  check_whole(call->options(), sub_verb);
  share_threads(settings);
  const Outcome outcome = work(*call, progress);
  const Json json = outcome.json.is_null() ? Json(outcome.text) : shown_json(outcome);
  return py::make_tuple(text_of(json), outcome.failure ? outcome.failure->what() : "");
}

// [(verb, sub-verb, meaning, its keywords as JSON), ...]
py::list list_verbs() {
  py::list rows;
  for (const Verb& verb : verbs()) {
    const auto call = verb.call();
    OptionList& list = call->options();
    rows.append(py::make_tuple(verb.name, "", verb.meaning, text_of(describe_keywords(list))));
    for (const SubVerb& sub : list.sub_verbs)
      rows.append(py::make_tuple(verb.name, sub.name, sub.meaning,
                                 text_of(describe_keywords(list, sub.name))));
  }
  return rows;
}

}  // namespace

void bind_jobs(py::module_& module) {
  LastWords::may_end_program = false;
  set_program_to_start(find_program("gemsplat").value_or("gemsplat"));
  module.def("run_job", run_job);
  module.def("list_verbs", list_verbs);
  module.def("nearest_word", nearest_word);
}

}  // namespace gs::python
