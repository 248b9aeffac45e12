// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/experiment_views.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "gs_app/experiment/tables/metrics.h"
#include "gs_app/run/csv.h"
#include "gs_app/run/provenance.h"
#include "gs_app/run/text.h"
#include "gs_core/config/text/markdown.h"

namespace gs {
namespace {

// As many as the report shows; results.json has all of them.
constexpr std::size_t kHashDigits = 10;

std::string text_of(const Json& value) {
  return value.is_string() ? value.get<std::string>() : value.dump();
}

// Of a value that is not negative, or has digits after the point.
std::string number_text(const Metric& metric, double value) {
  if (metric.digits > 0) return fmt::format("{:.{}f}", value / metric.unit, metric.digits);
  return with_commas(std::uint64_t(std::llround(value / metric.unit)));
}

// "25.31", "25.31 ± 0.12", "+0.20 ± 0.05" or "-"
std::string spread_text(const Metric& metric, const Json& entry, const char* spread_key) {
  if (!entry.contains(metric.key)) return "-";
  const Json& found = entry.at(metric.key);
  const auto mean = found.at("mean").get<double>();
  std::string text = number_text(metric, mean);
  if (std::string_view(spread_key) ==
      "standard_error") {  // a difference has a sign, unless it is 0
    text = number_text(metric, std::abs(mean));
    if (text.find_first_of("123456789") != text.npos) text = (mean < 0 ? "-" : "+") + text;
  }
  const Json& spread = found.at(spread_key);
  return spread.is_null() ? text : text + " ± " + number_text(metric, spread.get<double>());
}

// The metrics that at least one run has.
std::vector<Metric> metrics_in(const Json& runs) {
  std::vector<Metric> metrics;
  for (const Metric& metric : all_metrics())
    if (std::any_of(runs.begin(), runs.end(),
                    [&](const Json& run) { return value_of(run.at("results"), metric); }))
      metrics.push_back(metric);
  return metrics;
}

std::string titles_of(std::vector<std::string> titles, const std::vector<Metric>& metrics) {
  for (const Metric& metric : metrics) titles.push_back(metric.title);
  return markdown_header(titles);
}

// Entries of "summary", "scene_means" or "differences". `names` are the keys of their names;
// `count`, of how many runs, seeds or pairs there could be.
std::string table_of(const Json& entries, std::vector<std::string> names, const char* count,
                     const char* spread_key, const std::vector<Metric>& metrics) {
  std::vector<std::string> titles = names;
  titles.push_back(count);
  std::string text = titles_of(std::move(titles), metrics);
  for (const Json& entry : entries) {
    std::vector<std::string> cells;
    for (const std::string& name : names)
      cells.push_back(entry.at(name).is_null() ? "all" : text_of(entry.at(name)));
    cells.push_back(text_of(entry.at("finished")) + "/" + text_of(entry.at(count)));
    for (const Metric& metric : metrics) cells.push_back(spread_text(metric, entry, spread_key));
    text += markdown_row(cells);
  }
  return text;
}

std::string table_of_runs(const Json& runs, const std::vector<Metric>& metrics) {
  std::string text = titles_of({"scene", "config", "seed", "state"}, metrics);
  for (const Json& run : runs) {
    std::vector<std::string> cells;
    for (const char* key : {"scene", "config", "seed", "state"})
      cells.push_back(text_of(run.at(key)));
    for (const Metric& metric : metrics) {
      const auto value = value_of(run.at("results"), metric);
      cells.push_back(value ? number_text(metric, *value) : "-");
    }
    text += markdown_row(cells);
  }
  return text;
}

std::string settings_text(const Json& settings) {
  std::vector<std::string> all;
  for (const auto& [key, value] : settings.items())
    all.push_back(fmt::format("`{}` = {}", key, value.dump()));
  return fmt::format("{}", fmt::join(all, ", "));
}

std::string table_of_scenes(const Json& scenes) {
  std::string text = markdown_header({"scene", "its own settings", "configs", "training views",
                                      "test views", "size / px", "hash"});
  for (const Json& scene : scenes) {
    const std::string name = text_of(scene.at("name")), settings = settings_text(scene["settings"]);
    const Json& variants = scene.at("views");
    if (variants.empty()) text += markdown_row({name, settings, "-", "-", "-", "-", "-"});
    for (const Json& views : variants) {
      const auto configs = views.at("configs").get<std::vector<std::string>>();
      text += markdown_row(
          {name, settings,
           variants.size() == 1 ? "all" : fmt::format("{}", fmt::join(configs, ", ")),
           text_of(views.at("train_views")), text_of(views.at("test_views")),
           text_of(views.at("size")), text_of(views.at("scene_hash")).substr(0, kHashDigits)});
    }
  }
  return text;
}

std::string table_of_configs(const Json& configs) {
  std::string text = markdown_header({"config", "settings that differ from the defaults"});
  for (const Json& config : configs)
    text += markdown_row({text_of(config.at("name")), settings_text(config.at("settings"))});
  return text;
}

// Each combination of build and machine once: usually there is one.
std::string table_of_machines(const Json& runs) {
  std::string text = markdown_header(
      {"version", "commit", "uncommitted", "compiler", "CUDA", "device", "CPU", "driver"});
  std::vector<std::string> seen;
  for (const Json& run : runs) {
    const Json& results = run.at("results");
    if (results.is_null()) continue;
    std::vector<std::string> cells;
    for (const char* key :
         {"version", "commit", "uncommitted", "compiler", "cuda", "device", "cpu", "driver"}) {
      const auto value = results.find(key);
      const bool is_text = value != results.end() && value->is_string();
      cells.push_back(is_text ? value->get<std::string>() : "-");
    }
    const std::string line = markdown_row(cells);
    if (std::find(seen.begin(), seen.end(), line) != seen.end()) continue;
    seen.push_back(line);
    text += line;
  }
  return text;
}

std::string provenance_text(const Json& provenance) {
  std::vector<std::string> words;
  for (const Json& word : provenance.at("command")) words.push_back(shell_word(text_of(word)));
  std::string text = fmt::format("- command: `{}`, in `{}`\n- tables by {}, compiled by {}\n",
                                 fmt::join(words, " "), text_of(provenance.at("folder")),
                                 describe_build(), built_compiler());
  if (const Json& changes = provenance.at("uncommitted"); !changes.is_null())
    text += fmt::format("- uncommitted changes {} in {}: `{}`\n", text_of(changes.at("hash")),
                        text_of(changes.at("diff")),
                        fmt::join(changes.at("files").get<std::vector<std::string>>(), "`, `"));
  return text;
}

// A cell of a run's results; empty if it does not have it.
std::string csv_cell_of(const Json& results, const char* key) {
  return results.contains(key) ? csv_cell(text_of(results[key])) : "";
}

}  // namespace

std::string experiment_markdown(const Json& experiment) {
  const Json& runs = experiment.at("runs");
  const std::vector<Metric> metrics = metrics_in(runs);
  const auto finished = std::count_if(runs.begin(), runs.end(),
                                      [](const Json& run) { return !run.at("results").is_null(); });
  std::string text = fmt::format(
      "# {}\n\n{} of {} runs are finished. Means and standard deviations over seeds; written "
      "{}.\n\n{}\n",
      std::filesystem::path(text_of(experiment.at("experiment"))).filename().string(), finished,
      runs.size(), text_of(experiment.at("date")),
      table_of(experiment.at("summary"), {"scene", "config"}, "runs", "standard_deviation",
               metrics));
  if (const Json& means = experiment.at("scene_means"); !means.empty())
    text += fmt::format(
        "## Means over scenes\nOf seeds whose runs have finished in every scene.\n\n{}\n",
        table_of(means, {"config"}, "seeds", "standard_deviation", metrics));
  if (const Json& differences = experiment.at("differences"); !differences.empty())
    text += fmt::format(
        "## Differences to {}\nPaired by scene and seed; means ± standard errors.\n\n{}\n",
        text_of(experiment.at("baseline")),
        table_of(differences, {"config", "scene"}, "pairs", "standard_error", metrics));
  return text + fmt::format(
                    "## Runs\n{}\n"
                    "## Scenes\nA scene's own settings override those of the configs.\n\n{}\n"
                    "## Configs\n{}\n"
                    "## Made with\n{}\n{}",
                    table_of_runs(runs, metrics), table_of_scenes(experiment.at("scenes")),
                    table_of_configs(experiment.at("configs")), table_of_machines(runs),
                    provenance_text(experiment.at("provenance")));
}

std::string experiment_csv(const Json& experiment) {
  constexpr const char* kProvenance[] = {"iterations", "device",  "cpu",    "driver",
                                         "scene_hash", "version", "commit", "uncommitted",
                                         "compiler",   "cuda",    "date"};
  std::string text = "scene,config,seed,state";
  for (const Metric& metric : all_metrics()) text += fmt::format(",{}", metric.key);
  for (const char* key : kProvenance) text += fmt::format(",{}", key);
  text += ",folder\n";
  for (const Json& run : experiment.at("runs")) {
    text += fmt::format("{},{},{},{}", text_of(run.at("scene")), text_of(run.at("config")),
                        text_of(run.at("seed")), text_of(run.at("state")));
    for (const Metric& metric : all_metrics()) {
      const auto value = value_of(run.at("results"), metric);
      text += value ? fmt::format(",{}", *value) : ",";
    }
    for (const char* key : kProvenance) text += "," + csv_cell_of(run.at("results"), key);
    text += fmt::format(",{}\n", csv_cell(text_of(run.at("folder"))));
  }
  return text;
}

}  // namespace gs
