// SPDX-License-Identifier: Apache-2.0
// An experiment as its TOML file states it: scenes x configs x seeds. docs/experiments.md describes the file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/config/config.h"

namespace gs {

/// One `section.key=value` and where it stands.
struct PlacedSetting {
  std::string assignment;
  std::string place;  // "file:line: "
};

struct ExperimentScene {
  std::string name;  // of a folder of the output
  std::filesystem::path path;
  std::vector<PlacedSetting> settings;  // over those of the config
};

struct ExperimentConfig {
  std::string name;
  std::string base;  // a preset, an absolute path, or empty: the defaults
  std::vector<PlacedSetting> settings;
};

/// Grids are unrolled: each of their points is a config.
struct Experiment {
  std::filesystem::path file, output;
  std::vector<PlacedSetting> settings;  // of all runs, over the configs' bases
  std::vector<ExperimentScene> scenes;
  std::vector<ExperimentConfig> configs;
  std::vector<std::uint64_t> seeds;
  std::vector<std::string> slurm;  // "--partition=gpu", ... for sbatch
};

/// Reads the file. Throws UsageError that names file, line, key and the nearest known key; Error where it cannot be read or
/// a scene's folder does not exist.
Experiment read_experiment(const std::filesystem::path& file);

/// The settings of one run: config's base, `set` of the file, the config's, the scene's, then scene, seed and no output.
/// Validated. Throws as load_config and validate do, with the place.
Config settings_of(const Experiment& experiment, const ExperimentScene& scene,
                   const ExperimentConfig& config, std::uint64_t seed);

}  // namespace gs
