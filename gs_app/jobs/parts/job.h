// SPDX-License-Identifier: Apache-2.0
// A verb as data. A file of gs_app/jobs has a request with its defaults, the list of its options,
// and the work:
//
//   struct CountJob : JobSettings { std::string model; };
//   void visit_options(CountJob& job, OptionList& option) {
//     option("model", job.model, "a file of trained Gaussians").required();
//   }
//   Outcome run(const CountJob& job, JobEvents& events) { ... }
//   Verb count_verb() { return verb_of<CountJob>("count", VerbGroup::check, "Count Gaussians", {}); }
//
// verbs.cpp has a row for each verb. Nothing here knows of command lines.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gs_app/jobs/parts/option.h"
#include "gs_core/config/config.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// What a request says about the config, not yet applied: defaults, then config files, then
/// settings, then flags; a later one wins.
struct JobSettings {
  std::vector<std::string> config_files;  // -c, in order
  std::vector<std::string> settings;      // --set, in order
  std::vector<std::string> flags;         // "section.key=value" of every flag given, in order
  std::vector<std::string> given;         // names of all options that were given
  bool quiet = false, verbose = false;

  Verbosity verbosity() const;
  /// Whether a flag for that setting was given.
  bool has(const std::string& key) const;
  /// Whether this option, "--keys", was given.
  bool was_given(const std::string& name) const;
};

/// The settings over `start`, validated; in `origins`, where given, what came from where. Throws
/// UsageError.
Config resolve(const JobSettings& job, Config start = {}, SettingOrigins* origins = nullptr);

/// The same for a verb that computes: with the threads that they ask for from here on.
Config resolve_to_work(const JobSettings& job, Config start = {});

/// The files and folders that a request and its settings name to be read. None of them is ever
/// moved.
std::vector<std::filesystem::path> inputs_of(const JobSettings& job, const Config& config);

/// The command that one most likely wants next: {"look at it", "gemsplat view out/scene"}.
struct NextCommand {
  std::string why, command;
};

/// What a verb has found or made.
struct Outcome {
  std::string text = {};  // what a terminal shows, whole lines
  Json json = nullptr;
  std::vector<NextCommand> next = {};  // none only where nothing is shown
  bool is_answer = false;              // the text is what was asked for, also with -q
  std::optional<Error> failure = {};   // said after the text
};

/// The outcome's JSON, with the commands that come next: what --json prints.
Json shown_json(const Outcome& outcome);

/// What a verb tells while it works.
class JobEvents {
 public:
  virtual ~JobEvents() = default;
  /// `done` of `total` units of a part are complete: "photos read", "photo". A part may have no
  /// name, and is over when all is done.
  virtual void progress(const std::string& part, const char* unit, std::size_t done,
                        std::size_t total) {
    (void)part, (void)unit, (void)done, (void)total;
  }
  /// Text of the outcome that is known before the end, whole lines. What is no answer is not shown
  /// with -q, nor beside JSON.
  virtual void say(const std::string& text, bool is_answer = false) { (void)text, (void)is_answer; }
  /// Whether the outcome is shown as JSON.
  virtual bool wants_json() const { return true; }
};

/// One call of a verb: a request, which options fill, and its work.
class VerbCall {
 public:
  virtual ~VerbCall() = default;
  virtual OptionList& options() = 0;
  virtual const JobSettings& settings() const = 0;
  virtual Outcome work(JobEvents& events) = 0;
};

/// The headings of `gemsplat --help`.
enum class VerbGroup { train, look, change, compare, check };
const char* heading_of(VerbGroup group);

struct Verb {
  const char* name;
  VerbGroup group;
  const char* meaning;
  std::vector<std::string> examples;  // commands without "gemsplat"
  std::unique_ptr<VerbCall> (*call)();
};

template <class Job>
class CallOf final : public VerbCall {
 public:
  CallOf() : options_(job_) { visit_options(job_, options_); }
  OptionList& options() override { return options_; }
  const JobSettings& settings() const override { return job_; }
  Outcome work(JobEvents& events) override { return run(job_, events); }

 private:
  Job job_;
  OptionList options_;
};

/// `Job` has visit_options() and run(), as above.
template <class Job>
Verb verb_of(const char* name, VerbGroup group, const char* meaning,
             std::vector<std::string> examples) {
  return {name, group, meaning, std::move(examples),
          []() -> std::unique_ptr<VerbCall> { return std::make_unique<CallOf<Job>>(); }};
}

}  // namespace gs
