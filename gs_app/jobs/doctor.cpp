// SPDX-License-Identifier: Apache-2.0
// gemsplat doctor: reports the faults of a scene in plain words.
#include "data_loaders/doctor/doctor.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/text.h"
#include "gs_app/session/load_run_scene.h"
#include "gs_core/system/text/foreign_text.h"

namespace gs {
namespace {

struct DoctorJob : JobSettings {
  bool headers_only = false;
};

void visit_options(DoctorJob& job, OptionList& option) {
  option.json_meaning = "print JSON with the names of all photos concerned";
  option("--headers-only", job.headers_only,
         "do not decode the photos; faster, but blur and exposure are not checked");
  dataset_options(option, "scene,-d,--data,-s,--source-path");
  general_options(option);
}

constexpr std::size_t kNamesShown = 10;

/// What text and JSON say of a level.
struct LevelWords {
  const char *word, *mark;
};

LevelWords words_of(Finding::Level level) {
  switch (level) {
    case Finding::Level::good: return {"good", "ok  "};
    case Finding::Level::note: return {"note", "    "};
    case Finding::Level::warning: return {"warning", "!   "};
    case Finding::Level::fatal: return {"fatal", "STOP"};
  }
  return {"", ""};
}

std::string text_of(const Diagnosis& diagnosis) {
  std::string text;
  for (const Finding& finding : diagnosis.findings) {
    text += fmt::format("{} {:<12} {}\n", words_of(finding.level).mark, finding.topic,
                        printable(finding.text));
    std::string names;
    for (std::size_t i = 0; i < std::min(finding.names.size(), kNamesShown); ++i)
      names += (i ? ", " : "") + shown_word(finding.names[i]);
    if (finding.names.size() > kNamesShown)
      names +=
          fmt::format(", and {} more (all of them: --json)", finding.names.size() - kNamesShown);
    if (!names.empty()) text += fmt::format("{:18}{}\n", "", names);
  }
  return text + (diagnosis.can_train() ? "training can start\n" : "training cannot start\n");
}

Json json_of(const Diagnosis& diagnosis) {
  Json json = {{"can_train", diagnosis.can_train()}, {"findings", Json::array()}};
  for (const Finding& finding : diagnosis.findings)
    json["findings"].push_back({{"level", words_of(finding.level).word},
                                {"topic", finding.topic},
                                {"text", finding.text},
                                {"names", finding.names}});
  return json;
}

/// The device of a run with these settings. If there is none, the forecast does without it, and
/// training says why.
ForecastDevice device_of(const Config& config) {
  try {
    return forecast_device(*make_backend(config.train.device));
  } catch (const Error&) {
    return {};
  }
}

Outcome run(const DoctorJob& job, JobEvents& events) {
  const Config config = resolve_to_work(job);
  if (config.dataset.source.empty())
    throw UsageError("there is no scene; give its folder: gemsplat doctor SCENE");
  const auto show = [&](std::size_t done, std::size_t total) {
    if (!events.wants_json()) events.progress("", "photo", done, total);
  };
  const Diagnosis diagnosis = examine(config, !job.headers_only, show, device_of(config));
  Outcome outcome{text_of(diagnosis), json_of(diagnosis), {}, true};
  if (diagnosis.can_train())
    outcome.next = {{"train on it", "gemsplat train " + shell_word(config.dataset.source)}};
  else
    outcome.failure.emplace("training cannot start with this scene; the lines marked STOP say why");
  return outcome;
}

}  // namespace

Verb doctor_verb() {
  return verb_of<DoctorJob>(
      "doctor", VerbGroup::check, "Check the photos and cameras of a scene before training",
      {"doctor scene", "doctor photos", "doctor scene --headers-only --json"});
}

}  // namespace gs
