// SPDX-License-Identifier: Apache-2.0
#include "gs_app/jobs/parts/job.h"

#include <algorithm>

#include "gs_app/jobs/parts/foreign_flags.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

// Applies a flag. Where its value means something to other trainers, the refusal says what to give
// here.
std::string apply_flag(Config& config, const std::string& flag) {
  try {
    return apply_setting(config, flag);
  } catch (const UsageError& error) {
    const std::string own = own_value(flag);
    throw UsageError(error.what() + (own.empty() ? "" : "; here that is " + own));
  }
}

}  // namespace

Verbosity JobSettings::verbosity() const {
  return quiet ? Verbosity::quiet : verbose ? Verbosity::verbose : Verbosity::normal;
}

bool JobSettings::has(const std::string& key) const {
  return std::any_of(flags.begin(), flags.end(),
                     [&](const std::string& flag) { return flag.starts_with(key + "="); });
}

bool JobSettings::was_given(const std::string& name) const {
  return std::find(given.begin(), given.end(), name) != given.end();
}

Config resolve(const JobSettings& job, Config start, SettingOrigins* origins) {
  SettingOrigins known;
  for (const std::string& file : job.config_files) load_config(start, file, &known);
  for (const std::string& setting : job.settings) known[apply_setting(start, setting)] = "--set";
  for (const std::string& flag : job.flags) known[apply_flag(start, flag)] = "flag";
  validate(start, known);
  if (origins) *origins = std::move(known);
  return start;
}

Config resolve_to_work(const JobSettings& job, Config start) {
  const Config config = resolve(job, std::move(start));
  set_thread_count(config.train.threads);
  return config;
}

std::vector<std::filesystem::path> inputs_of(const JobSettings& job, const Config& config) {
  std::vector<std::filesystem::path> inputs = inputs_of(config);
  inputs.insert(inputs.end(), job.config_files.begin(), job.config_files.end());
  return inputs;
}

Json shown_json(const Outcome& outcome) {
  Json json = outcome.json;
  if (json.is_object())
    for (const NextCommand& next : outcome.next) json["next"].push_back(next.command);
  return json;
}

const char* heading_of(VerbGroup group) {
  switch (group) {
    case VerbGroup::train: return "Train";
    case VerbGroup::look: return "Look";
    case VerbGroup::change: return "Change";
    case VerbGroup::compare: return "Compare";
    case VerbGroup::check: return "Check";
  }
  return "";
}

}  // namespace gs
