// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/experiment_file.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>
#include <sstream>

#include "gs_app/experiment/experiment_grid.h"
#include "gs_core/config/text/nearest_word.h"
#include "gs_core/config/text/read_toml.h"
#include "gs_core/error.h"
#include "gs_core/system/text/foreign_text.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kDefaultSeed = 42;    // as in TrainConfig
constexpr std::size_t kLongestOption = 1000;  // bytes: longer ones are slips of the pen

[[noreturn]] void refuse(const fs::path& file, const toml::node& node, const std::string& what) {
  throw UsageError(place_in(file, node) + what);
}

void check_keys(const fs::path& file, const toml::table& table,
                const std::vector<std::string>& known) {
  for (const auto& [key, node] : table) {
    const std::string name(key.str());
    if (std::find(known.begin(), known.end(), name) != known.end()) continue;
    const std::string nearest = nearest_word(name, known);
    refuse(file, node,
           fmt::format("an experiment has no key {} here; {}", shown_word(name),
                       nearest.empty() ? fmt::format("it has {}", fmt::join(known, ", "))
                                       : "did you mean " + nearest + "?"));
  }
}

std::string text_at(const fs::path& file, const toml::table& table, const char* key) {
  const toml::node* node = table.get(key);
  if (!node) return "";
  const auto text = node->value_exact<std::string>();
  if (!text) refuse(file, *node, std::string(key) + " must be text in quotes");
  return *text;
}

const toml::table* table_at(const fs::path& file, const toml::table& table, const char* key) {
  const toml::node* node = table.get(key);
  if (node && !node->is_table())
    refuse(file, *node, std::string(key) + " must be a table of settings");
  return node ? node->as_table() : nullptr;
}

std::vector<PlacedSetting> settings_at(const fs::path& file, const toml::table& table,
                                       const char* key) {
  const toml::table* settings = table_at(file, table, key);
  return settings ? flat_settings(file, *settings) : std::vector<PlacedSetting>();
}

// Calls visit(element) for each of the list `key`.
template <class Visitor>
void visit_list(const fs::path& file, const toml::table& root, const char* key, Visitor&& visit) {
  const toml::node* node = root.get(key);
  if (!node) return;
  if (!node->is_array()) refuse(file, *node, std::string(key) + " must be a list: [...]");
  for (const toml::node& element : *node->as_array()) visit(element);
}

// False also for a name that no file can have.
bool can_be_found(const fs::path& path) {
  std::error_code ignored;
  return fs::exists(path, ignored);
}

ExperimentScene scene_of(const fs::path& file, const toml::node& node) {
  ExperimentScene scene;
  std::string path;
  if (const toml::table* table = node.as_table()) {
    check_keys(file, *table, {"path", "name", "set"});
    path = text_at(file, *table, "path");
    scene.name = text_at(file, *table, "name");
    scene.settings = settings_at(file, *table, "set");
  } else {
    path = node.value_exact<std::string>().value_or("");
  }
  if (path.empty()) refuse(file, node, "a scene needs the path of its folder");
  scene.path = fs::absolute(file.parent_path() / path).lexically_normal();
  if (!scene.path.has_filename()) scene.path = scene.path.parent_path();  // "scenes/a/"
  if (!can_be_found(scene.path))
    throw Error(place_in(file, node) + "there is no scene " + scene.path.string() +
                "; give a path that is relative to the experiment's file");
  scene.name = folder_name(scene.name.empty() ? scene.path.filename().string() : scene.name);
  return scene;
}

// A file beside the experiment's file, or else a preset.
std::string base_of(const fs::path& file, const std::string& name) {
  if (name.empty()) return name;
  const fs::path beside = fs::absolute(file.parent_path() / name).lexically_normal();
  return can_be_found(beside) ? beside.string() : name;
}

std::vector<ExperimentConfig> configs_of(const fs::path& file, const toml::node& node) {
  if (const auto name = node.value_exact<std::string>())
    return {{folder_name(fs::path(*name).stem().string()), base_of(file, *name), {}}};
  const toml::table* table = node.as_table();
  if (!table) refuse(file, node, "a config is a preset, a TOML file, or a table with a name");
  check_keys(file, *table, {"name", "base", "set", "grid"});
  const std::string base = text_at(file, *table, "base"), name = text_at(file, *table, "name");
  if (name.empty() && base.empty()) refuse(file, node, "a config needs a name or a base");
  const ExperimentConfig config{folder_name(name.empty() ? fs::path(base).stem().string() : name),
                                base_of(file, base), settings_at(file, *table, "set")};
  const toml::table* grid = table_at(file, *table, "grid");
  return grid ? unrolled(file, config, *grid) : std::vector<ExperimentConfig>{config};
}

std::string baseline_of(const fs::path& file, const toml::table& root,
                        const Experiment& experiment) {
  const std::string name = text_at(file, root, "baseline");
  std::vector<std::string> names;
  for (const ExperimentConfig& config : experiment.configs) names.push_back(config.name);
  if (name.empty() || std::find(names.begin(), names.end(), name) != names.end()) return name;
  const std::string nearest = nearest_word(name, names);
  refuse(file, *root.get("baseline"),
         fmt::format("baseline names no config: {}; {}", shown_word(name),
                     nearest.empty() ? fmt::format("the configs are {}", fmt::join(names, ", "))
                                     : "did you mean " + nearest + "?"));
}

std::uint64_t seed_of(const fs::path& file, const toml::node& node) {
  const auto seed = node.value_exact<std::int64_t>();
  if (!seed || *seed < 0) refuse(file, node, "a seed must be a whole number, 0 or larger");
  return std::uint64_t(*seed);
}

std::vector<std::string> slurm_options(const fs::path& file, const toml::table& root) {
  std::vector<std::string> options;
  const toml::table* table = table_at(file, root, "slurm");
  if (!table) return options;
  for (const auto& [key, node] : *table) {
    const std::string value = value_text(node), name(key.str());
    if (!node.is_value() || value.find('\n') != value.npos)
      refuse(file, node, "an option of sbatch is text or a number");
    options.push_back(fmt::format("--{}={}", name, value));
    if (const std::size_t size = options.back().size(); size > kLongestOption)
      refuse(file, node,
             fmt::format("an option of sbatch has {} bytes at most here, and this one has {}",
                         kLongestOption, size));
  }
  return options;
}

template <class Named>
void check_names(const Experiment& experiment, const std::vector<Named>& all, const char* what) {
  std::set<std::string> seen;
  for (const Named& one : all)
    if (!seen.insert(one.name).second)
      throw UsageError(
          fmt::format("{}: two {} have the name {}; give one another name with name = ...",
                      experiment.file.string(), what, one.name));
}

// The tables of an experiment name it, and they are UTF-8.
void check_is_utf8(const Experiment& experiment) {
  std::vector<std::string> names = {experiment.file.string(), experiment.output.string()};
  for (const ExperimentScene& scene : experiment.scenes) names.push_back(scene.name);
  for (const ExperimentConfig& config : experiment.configs) names.push_back(config.name);
  for (const std::string& name : names)
    if (!is_utf8(name))
      throw UsageError(name +
                       " is not UTF-8, so that no table of the experiment can name it; rename the "
                       "file or folder");
}

// The settings of the config's preset or file.
Config base_settings(const Experiment& experiment, const ExperimentConfig& config) {
  Config settings;
  try {
    if (!config.base.empty()) load_config(settings, config.base);
  } catch (const Error& error) {
    throw Error(
        fmt::format("{}: config {}: {}", experiment.file.string(), config.name, error.what()),
        error.code());
  }
  return settings;
}

void apply(Config& config, const std::vector<PlacedSetting>& settings, SettingOrigins& origins) {
  for (const PlacedSetting& setting : settings) {
    try {
      origins[apply_setting(config, setting.assignment)] = setting.place;
    } catch (const UsageError& error) {
      throw UsageError(setting.place + error.what());
    }
  }
}

Config config_settings(const Experiment& experiment, const ExperimentConfig& config,
                       SettingOrigins& origins) {
  Config settings = base_settings(experiment, config);
  apply(settings, experiment.settings, origins);
  apply(settings, config.settings, origins);
  return settings;
}

}  // namespace

Experiment read_experiment(const fs::path& file) {
  const toml::table root = parse_toml(read_toml_text(file), file.string());
  check_keys(file, root, {"output", "scenes", "configs", "baseline", "seeds", "set", "slurm"});
  Experiment experiment;
  experiment.file = fs::absolute(file).lexically_normal();
  const std::string output = text_at(file, root, "output");
  experiment.output =
      fs::absolute(file.parent_path() / (output.empty() ? file.stem().string() + "-runs" : output))
          .lexically_normal();
  if (!experiment.output.has_filename()) experiment.output = experiment.output.parent_path();
  experiment.settings = settings_at(file, root, "set");
  visit_list(file, root, "scenes",
             [&](const auto& node) { experiment.scenes.push_back(scene_of(file, node)); });
  visit_list(file, root, "configs", [&](const auto& node) {
    for (ExperimentConfig& config : configs_of(file, node))
      experiment.configs.push_back(std::move(config));
    if (experiment.configs.size() > kMostRuns) refuse_runs(place_in(file, node));
  });
  visit_list(file, root, "seeds",
             [&](const auto& node) { experiment.seeds.push_back(seed_of(file, node)); });
  if (experiment.scenes.empty())
    throw UsageError(file.string() + " names no scene; add scenes = [\"path/to/scene\"]");
  if (experiment.configs.empty()) experiment.configs.push_back({"default", "", {}});
  if (experiment.seeds.empty()) experiment.seeds.push_back(kDefaultSeed);
  experiment.slurm = slurm_options(file, root);
  check_is_utf8(experiment);
  check_names(experiment, experiment.scenes, "scenes");
  check_names(experiment, experiment.configs, "configs");
  experiment.baseline = baseline_of(file, root, experiment);
  if (double(experiment.scenes.size()) * double(experiment.configs.size()) *
          double(experiment.seeds.size()) >
      double(kMostRuns))
    refuse_runs(file.string() + ": ");
  if (std::set<std::uint64_t>(experiment.seeds.begin(), experiment.seeds.end()).size() !=
      experiment.seeds.size())
    throw UsageError(file.string() + " names a seed twice; leave one out");
  return experiment;
}

Config settings_of(const Experiment& experiment, const ExperimentConfig& config) {
  SettingOrigins origins;
  return config_settings(experiment, config, origins);
}

Config settings_of(const Experiment& experiment, const ExperimentScene& scene,
                   const ExperimentConfig& config, std::uint64_t seed) {
  SettingOrigins origins;
  Config settings = config_settings(experiment, config, origins);
  apply(settings, scene.settings, origins);
  settings.dataset.source = scene.path.string();
  settings.train.seed = seed;
  settings.model.output.clear();
  const auto beside_file = [&](std::string& path) {
    if (!path.empty()) path = (experiment.file.parent_path() / path).lexically_normal().string();
  };
  beside_file(settings.model.start_from);
  beside_file(settings.dataset.photo_list);
  if (settings.eval.lpips != "none") beside_file(settings.eval.lpips);
  validate(settings, origins);
  return settings;
}

}  // namespace gs
