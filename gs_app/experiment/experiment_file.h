// SPDX-License-Identifier: Apache-2.0
// An experiment as its TOML file states it: scenes x configs x seeds. docs/guide/experiments.md
// describes the file. Start reading this folder here.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/config/config.h"

namespace gs {

/// One `section.key=value` and its place in the file.
struct PlacedSetting {
  std::string assignment;
  std::string place;  // "file:line: "
};

struct ExperimentScene {
  std::string name;  // of its folder in the output
  std::filesystem::path path;
  std::vector<PlacedSetting> settings;  // they override those of the config
};

struct ExperimentConfig {
  std::string name;
  std::string base;  // a preset or an absolute path; empty for the defaults
  std::vector<PlacedSetting> settings;
};

/// A whole experiment. Grids are unrolled: each of their points is a config.
struct Experiment {
  std::filesystem::path file, output;
  std::vector<PlacedSetting> settings;  // of all runs; they override the configs' bases
  std::vector<ExperimentScene> scenes;
  std::vector<ExperimentConfig> configs;
  std::string baseline;  // the config that the others are compared with; may be empty
  std::vector<std::uint64_t> seeds;
  std::vector<std::string> slurm;  // options of sbatch: "--partition=gpu", ...
};

/// Throws UsageError that names file, line, key and the nearest known key, or Error if the file
/// cannot be read or a scene's folder does not exist.
Experiment read_experiment(const std::filesystem::path& file);

/// The settings of a config by itself: its base, then the file's [set], then its own. They are not
/// validated, since a scene may still change them. Throws like load_config, naming the place.
Config settings_of(const Experiment& experiment, const ExperimentConfig& config);

/// The settings of one run: those of the config, then the scene's `set`, then the scene and the
/// seed; no output folder. A model to start from and a list of photos are relative to the file.
/// Validated. Throws like load_config and validate, naming the place.
Config settings_of(const Experiment& experiment, const ExperimentScene& scene,
                   const ExperimentConfig& config, std::uint64_t seed);

}  // namespace gs
