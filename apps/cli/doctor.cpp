// SPDX-License-Identifier: Apache-2.0
// gemsplat doctor: reports the faults of a scene in plain words.
#include "data_loaders/doctor/doctor.h"

#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>

#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/progress_bar.h"
#include "gs_app/session/load_run_scene.h"
#include "gs_core/error.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/json.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

struct DoctorCommand : CommandLine {
  bool json = false, headers_only = false;
};

constexpr std::size_t kNamesShown = 10;

const char* word_of(Finding::Level level) {
  switch (level) {
    case Finding::Level::good: return "good";
    case Finding::Level::note: return "note";
    case Finding::Level::warning: return "warning";
    case Finding::Level::fatal: return "fatal";
  }
  return "";
}
const char* mark_of(Finding::Level level) {
  switch (level) {
    case Finding::Level::good: return "ok  ";
    case Finding::Level::note: return "    ";
    case Finding::Level::warning: return "!   ";
    case Finding::Level::fatal: return "STOP";
  }
  return "";
}

std::string text_of(const Diagnosis& diagnosis) {
  std::string text;
  for (const Finding& finding : diagnosis.findings) {
    text += fmt::format("{} {:<12} {}\n", mark_of(finding.level), finding.topic,
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

std::string json_of(const Diagnosis& diagnosis) {
  Json json = {{"can_train", diagnosis.can_train()}, {"findings", Json::array()}};
  for (const Finding& finding : diagnosis.findings)
    json["findings"].push_back({{"level", word_of(finding.level)},
                                {"topic", finding.topic},
                                {"text", finding.text},
                                {"names", finding.names}});
  return json.dump(2, ' ', false, SortedJson::error_handler_t::replace) + "\n";
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

void doctor(const DoctorCommand& command) {
  const Config config = resolve(command);
  if (config.dataset.source.empty())
    throw UsageError("there is no scene; give its folder: gemsplat doctor SCENE");
  setup_log(command.verbosity());
  set_thread_count(config.train.threads);
  std::unique_ptr<ProgressBar> bar;
  const bool show_progress = !command.quiet && !command.json;
  const auto show = [&](std::size_t done, std::size_t total) {
    if (!bar) bar = std::make_unique<ProgressBar>(std::int64_t(total), show_progress);
    if (bar->due(std::int64_t(done))) bar->draw(std::int64_t(done), "", "photo");
  };
  const Diagnosis diagnosis = examine(config, !command.headers_only, show, device_of(config));
  if (bar) bar->clear();
  std::cout << (command.json ? json_of(diagnosis) : text_of(diagnosis));
  if (!diagnosis.can_train())
    throw Error("training cannot start with this scene; the lines marked STOP say why");
}

}  // namespace

void add_doctor(CLI::App& program) {
  CLI::App& verb =
      *program.add_subcommand("doctor", "Check the photos and cameras of a scene before training");
  const auto command = std::make_shared<DoctorCommand>();
  verb.add_flag("--json", command->json, "print JSON with the names of all photos concerned");
  verb.add_flag("--headers-only", command->headers_only,
                "do not decode the photos; faster, but blur and exposure are not checked");
  add_dataset_options(verb, *command, "scene,-d,--data,-s,--source-path");
  add_general_options(verb, *command);
  verb.callback([command] { doctor(*command); });
}

}  // namespace gs
