// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/run_verb.h"

#include <CLI/CLI.hpp>
#include <iostream>

#include "apps/cli/bind_options.h"
#include "apps/cli/help.h"
#include "gs_app/jobs/parts/bar_events.h"

namespace gs {
namespace {

/// Progress as a bar for each part, and text on standard output.
class TerminalEvents final : public BarEvents {
 public:
  explicit TerminalEvents(const BoundVerb& bound)
      : BarEvents(!bound.call->settings().quiet), is_quiet_(bound.call->settings().quiet),
        wants_json_(bound.json) {}

  void say(const std::string& text, bool is_answer) override {
    end_bar();
    if (is_answer || !(is_quiet_ || wants_json_)) std::cout << text << std::flush;
  }
  bool wants_json() const override { return wants_json_; }

 private:
  bool is_quiet_, wants_json_;
};

Verbosity g_verbosity = Verbosity::normal;
bool g_writes_json_events = false;

// A line of the log as an object: {"event": "log", "level": "warning", "text": "..."}.
void log_as_json(detail::LogLevel level, std::string_view line) {
  if (level == detail::LogLevel::info && g_verbosity == Verbosity::quiet) return;
  const char* const word = level == detail::LogLevel::info      ? "info"
                           : level == detail::LogLevel::warning ? "warning"
                                                                : "error";
  write_progress_json({{"event", "log"}, {"level", word}, {"text", std::string(line)}});
}

void set_up_messages(const BoundVerb& bound) {
  g_verbosity = bound.call->settings().verbosity();
  setup_log(g_verbosity);
  if (bound.progress == "none") set_progress_style(ProgressStyle::none);
  if (bound.progress != "json") return;
  g_writes_json_events = true;
  set_progress_style(ProgressStyle::json);
  detail::set_log_sink(log_as_json);
}

// Behind an answer, which may go to a file, the commands go to standard error.
void show(const BoundVerb& bound, const Outcome& outcome) {
  const bool is_quiet = bound.call->settings().quiet;
  if (bound.json) {
    if (!outcome.json.is_null()) std::cout << file_text(shown_json(outcome));
  } else {
    if (!is_quiet || outcome.is_answer) std::cout << outcome.text << std::flush;
    for (const NextCommand& next : outcome.next) {
      const std::string line = next.why + ": " + next.command;
      if (outcome.is_answer)
        log_info("{}", line);
      else if (!is_quiet)
        std::cout << line << "\n";
    }
  }
  std::cout.flush();
  if (outcome.failure) throw Error(*outcome.failure);
}

void run(BoundVerb& bound) {
  take_parsed(*bound.app, bound.call->options());
  set_up_messages(bound);
  TerminalEvents events(bound);
  show(bound, bound.call->work(events));
}

/// The help of a verb or sub-verb in place of CLI11's.
class ListedHelp final : public CLI::FormatterBase {
 public:
  ListedHelp(const BoundVerb& bound, std::string name, std::string meaning, const OptionList& list)
      : bound_(bound), name_(std::move(name)), meaning_(std::move(meaning)), list_(list) {}
  std::string make_help(const CLI::App*, std::string, CLI::AppFormatMode mode) const override {
    const bool is_whole = name_ == bound_.verb.name;
    return help_of_verb(name_, meaning_, list_,
                        is_whole ? bound_.verb.examples : std::vector<std::string>(),
                        mode == CLI::AppFormatMode::All, help_width());
  }

 private:
  const BoundVerb& bound_;
  std::string name_, meaning_;
  const OptionList& list_;
};

}  // namespace

bool writes_json_events() { return g_writes_json_events; }

void add_common_options(BoundVerb& bound) {
  OptionList& list = bound.call->options();
  list("--json", bound.json, list.json_meaning).group("Messages");
  list("--progress", bound.progress,
       "how progress is shown: a bar, or lines of JSON on standard error, messages included [bar]")
      .one_of({"bar", "json", "none"})
      .group("Messages")
      .rare();
}

void add_verb(CLI::App& program, const Verb& verb) {
  auto bound = std::make_shared<BoundVerb>(BoundVerb{verb, verb.call(), nullptr});
  add_common_options(*bound);
  const OptionList& list = bound->call->options();
  CLI::App& app = *program.add_subcommand(verb.name, verb.meaning);
  bound->app = &app;
  app.formatter(std::make_shared<ListedHelp>(*bound, verb.name, verb.meaning, list));
  bind_options(app, list);
  for (const SubVerb& sub : list.sub_verbs)
    app.get_subcommand(sub.name)->formatter(std::make_shared<ListedHelp>(
        *bound, std::string(verb.name) + " " + sub.name, sub.meaning, sub.options));
  app.callback([bound] { run(*bound); });
}

}  // namespace gs
