// SPDX-License-Identifier: Apache-2.0
// A verb's options as keyword arguments, for programs that call a verb with values and not with
// words of a command line: the module of Python, and what else can write JSON.
#pragma once

#include <string>
#include <vector>

#include "gs_app/jobs/parts/job.h"

namespace gs {

/// "checkpoint_every" of "--checkpoint-every", and "scene" of a place. Empty where the caller says
/// it in another way: hidden names, -q and -v.
std::string keyword_of(const Option& option, const JobSettings& settings);

/// The options of a verb, or of its sub-verb such as `config diff`, in the order of --help; each one
/// {"name", "kind", "several", "choices", "setting", "stands_alone", "default", "place", "required",
/// "meaning"}. The kind is "bool", "int", "float" or "text"; a number that is a setting may be a word,
/// such as auto, and what stands alone may be true. "choices" are all words or numbers that there
/// are. The default is null where the verb or the config finds a value.
Json describe_keywords(OptionList& list, const std::string& sub_verb = "");

/// Fills a request: {"scene": "photos", "iterations": 500, "eval": true}. Operations keep their
/// order, and null is not given. --set also takes an object, {"train": {"seed": 1}}. Throws
/// UsageError, which names the keyword and what it takes, or the nearest keyword.
void take_keywords(OptionList& list, const Json& values, const std::string& sub_verb = "");

/// Throws UsageError where a request lacks what the verb needs.
void check_whole(const OptionList& list, const std::string& sub_verb = "");

/// An object of settings, nested or with dots in its names, as "section.key=value". Throws
/// UsageError for a value that no setting takes.
std::vector<std::string> setting_texts_of(const Json& object, const std::string& section = "");

/// Applies null; the name of a preset, a TOML file or a run's folder; an object of settings; or a
/// list of these, the later over the earlier. Throws UsageError that names an unknown setting and
/// the nearest known one. Ranges are left to validate().
void apply_settings(Config& config, const Json& settings);

/// A call of the verb of that name. Throws UsageError if there is none.
std::unique_ptr<VerbCall> call_of(const std::string& verb);

/// Some keywords of a verb, for other work than the verb's.
class FilledVerb {
 public:
  FilledVerb(const std::string& verb, const Json& values);

  /// What an option of the verb holds: get<bool>("--force").
  template <class T>
  const T& get(const std::string& name) const {
    return *std::get<T*>(call_->options().get(name).value);
  }
  JobSettings& settings() const { return call_->options().settings; }
  /// Applies the options that are settings.
  void apply_to(Config& config) const;
  /// That of --device, or auto.
  std::string device() const;

 private:
  std::unique_ptr<VerbCall> call_;
};

}  // namespace gs
