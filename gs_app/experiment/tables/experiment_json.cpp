// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/experiment_json.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

#include "gs_app/experiment/tables/metrics.h"
#include "gs_app/experiment/tables/scene_views.h"
#include "gs_core/config/config_diff.h"
#include "gs_core/config/text/config_text.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/text/read_json.h"
#include "gs_core/system/version.h"

namespace gs {
namespace {

using Entries = std::vector<const Json*>;  // of "runs"

// TOML text of a value is also JSON, unless it has bytes that are not UTF-8, as paths may have.
Json json_of(const std::string& toml) {
  Json value = Json::parse(toml, nullptr, false);
  return value.is_discarded() ? Json(toml) : value;
}

// {"density.every": 50, ...}: the settings that differ from the defaults.
Json settings_json(const Config& config) {
  Json json = Json::object();
  for (const SettingChange& change : config_diff(Config{}, config))
    json[change.key] = json_of(change.b);
  return json;
}

Json settings_json(const ExperimentScene& scene) {
  Config config;
  Json json = Json::object();
  for (const PlacedSetting& setting : scene.settings) {
    const std::string key = apply_setting(config, setting.assignment);
    visit_fields(config, [&](const auto& field) {
      if (field.key == key) json[key] = json_of(toml_text(field.value));
    });
  }
  return json;
}

Json run_json(const ExperimentRun& run, bool has_failed) {
  Json results = is_finished(run) ? results_of(run) : Json(nullptr);
  const char* state = !results.is_null() ? "finished" : has_failed ? "failed" : "missing";
  return {{"scene", run.scene},
          {"config", run.config},
          {"seed", run.seed},
          {"state", state},
          {"folder", run.folder.root().string()},
          {"settings", settings_json(run.settings)},
          {"results", std::move(results)}};
}

// The values of a key, in the order of the first runs that have them.
std::vector<std::string> names_in(const Json& runs, const char* key) {
  std::vector<std::string> names;
  for (const Json& run : runs)
    if (const auto name = run.at(key).get<std::string>();
        std::find(names.begin(), names.end(), name) == names.end())
      names.push_back(name);
  return names;
}

// The runs of a config in a scene, or in all scenes where it is empty.
Entries runs_in(const Json& runs, const std::string& scene, const std::string& config) {
  Entries entries;
  for (const Json& run : runs)
    if (run.at("config") == config && (scene.empty() || run.at("scene") == scene))
      entries.push_back(&run);
  return entries;
}

bool has_results(const Json* run) { return !run->at("results").is_null(); }

std::vector<double> values_of(const Entries& runs, const Metric& metric) {
  std::vector<double> values;
  for (const Json* run : runs)
    if (const auto value = value_of(run->at("results"), metric)) values.push_back(*value);
  return values;
}

// Adds to an entry, for each metric that has values, their mean and the standard deviation of a
// sample (n - 1), or the standard error of the mean. One value has none.
void add_metrics(Json& entry, const char* spread,
                 const std::function<std::vector<double>(const Metric&)>& values_of_metric) {
  const bool is_error = std::string_view(spread) == "standard_error";
  for (const Metric& metric : all_metrics()) {
    const std::vector<double> values = values_of_metric(metric);
    if (values.empty()) continue;
    const double count = double(values.size());
    double mean = 0, squares = 0;
    for (const double value : values) mean += value / count;
    for (const double value : values) squares += (value - mean) * (value - mean);
    const double deviation = std::sqrt(squares / (count - 1));
    entry[metric.key] = {
        {"mean", mean},
        {spread, count < 2 ? Json(nullptr) : Json(deviation / (is_error ? std::sqrt(count) : 1))}};
  }
}

Json summary_json(const Json& runs) {
  Json summary = Json::array();
  for (const std::string& scene : names_in(runs, "scene"))
    for (const std::string& config : names_in(runs, "config")) {
      const Entries entries = runs_in(runs, scene, config);
      const auto finished = std::count_if(entries.begin(), entries.end(), has_results);
      Json entry = {
          {"scene", scene}, {"config", config}, {"finished", finished}, {"runs", entries.size()}};
      add_metrics(entry, "standard_deviation",
                  [&](const Metric& metric) { return values_of(entries, metric); });
      summary.push_back(std::move(entry));
    }
  return summary;
}

Json scene_means_json(const Json& runs) {
  Json means = Json::array();
  const std::size_t scenes = names_in(runs, "scene").size();
  if (scenes < 2) return means;
  for (const std::string& config : names_in(runs, "config")) {
    std::map<std::uint64_t, Entries> seeds;  // their finished runs
    for (const Json* run : runs_in(runs, "", config)) {
      Entries& of_seed = seeds[run->at("seed").get<std::uint64_t>()];
      if (has_results(run)) of_seed.push_back(run);
    }
    const std::size_t wanted = seeds.size();
    std::erase_if(seeds, [&](const auto& seed) { return seed.second.size() < scenes; });
    Json entry = {{"config", config}, {"finished", seeds.size()}, {"seeds", wanted}};
    add_metrics(entry, "standard_deviation", [&](const Metric& metric) {
      std::vector<double> of_seeds;
      for (const auto& [seed, of_seed] : seeds) {
        const std::vector<double> values = values_of(of_seed, metric);
        if (values.size() < scenes) return std::vector<double>();
        double sum = 0;
        for (const double value : values) sum += value;
        of_seeds.push_back(sum / double(scenes));
      }
      return of_seeds;
    });
    means.push_back(std::move(entry));
  }
  return means;
}

const Json* partner_of(const Json& run, const Json& runs, const std::string& baseline) {
  const auto partner = std::find_if(runs.begin(), runs.end(), [&](const Json& other) {
    return other.at("config") == baseline && other.at("scene") == run.at("scene") &&
           other.at("seed") == run.at("seed");
  });
  return partner == runs.end() ? nullptr : &*partner;
}

// For each config but the baseline: all scenes, then each of several.
Json differences_json(const Json& runs, const std::string& baseline) {
  Json differences = Json::array();
  if (baseline.empty()) return differences;
  std::vector<std::string> scenes = names_in(runs, "scene");
  if (scenes.size() > 1) scenes.insert(scenes.begin(), "");
  for (const std::string& config : names_in(runs, "config")) {
    if (config == baseline) continue;
    for (const std::string& scene : scenes) {
      const Entries entries = runs_in(runs, scene, config);
      std::vector<std::pair<const Json*, const Json*>> pairs;  // the results of baseline and config
      for (const Json* run : entries)
        if (const Json* partner = partner_of(*run, runs, baseline);
            partner && has_results(partner) && has_results(run))
          pairs.push_back({&partner->at("results"), &run->at("results")});
      Json entry = {{"config", config},
                    {"scene", scene.empty() ? Json(nullptr) : Json(scene)},
                    {"finished", pairs.size()},
                    {"pairs", entries.size()}};
      add_metrics(entry, "standard_error", [&](const Metric& metric) {
        std::vector<double> values;
        for (const auto& [before, after] : pairs)
          if (const auto a = value_of(*before, metric), b = value_of(*after, metric); a && b)
            values.push_back(*b - *a);
        return values;
      });
      differences.push_back(std::move(entry));
    }
  }
  return differences;
}

}  // namespace

Json results_of(const ExperimentRun& run) {
  try {
    return read_json(run.folder.results());
  } catch (const AccessError&) {
    throw;
  } catch (const Error&) {
    return nullptr;
  }
}

Json provenance_json(const std::optional<UncommittedChanges>& uncommitted) {
  std::error_code ignored;
  const CudaBuild cuda = built_cuda();
  Json json = {{"command", command_line()},
               {"folder", std::filesystem::current_path(ignored).string()},
               {"version", kVersion},
               {"commit", built_commit()},
               {"compiler", built_compiler()},
               {"cuda", cuda.toolkit.empty() ? Json(nullptr) : Json(cuda.toolkit)},
               {"uncommitted", nullptr}};
  if (uncommitted)
    json["uncommitted"] = {{"hash", uncommitted->hash},
                           {"files", uncommitted->files},
                           {"diff", fmt::format("uncommitted-{}.diff", uncommitted->hash)}};
  return json;
}

Json experiment_json(const Experiment& experiment, const std::vector<ExperimentRun>& runs,
                     const std::vector<std::size_t>& failed) {
  Json entries = Json::array(), scenes = Json::array(), configs = Json::array();
  for (const ExperimentRun& run : runs)
    entries.push_back(
        run_json(run, std::find(failed.begin(), failed.end(), run.index) != failed.end()));
  for (const ExperimentScene& scene : experiment.scenes)
    scenes.push_back({{"name", scene.name},
                      {"path", scene.path.string()},
                      {"settings", settings_json(scene)},
                      {"views", views_json(scene.name, entries)}});
  for (const ExperimentConfig& config : experiment.configs)
    configs.push_back(
        {{"name", config.name}, {"settings", settings_json(settings_of(experiment, config))}});
  const std::string& baseline = experiment.baseline;
  Json json = {{"experiment", experiment.file.string()},
               {"version", kVersion},
               {"commit", built_commit()},
               {"date", utc_date()},
               {"provenance", provenance_json(uncommitted_changes())},
               {"scenes", std::move(scenes)},
               {"configs", std::move(configs)},
               {"summary", summary_json(entries)},
               {"scene_means", scene_means_json(entries)},
               {"baseline", baseline.empty() ? Json(nullptr) : Json(baseline)},
               {"differences", differences_json(entries, baseline)}};
  json["runs"] = std::move(entries);
  return json;
}

}  // namespace gs
