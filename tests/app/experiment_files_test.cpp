// SPDX-License-Identifier: Apache-2.0
// Every file in configs/experiments names settings that exist, with values that are valid together.
#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <vector>

#include "gs_app/experiment/experiment_file.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> experiment_files() {
  std::vector<fs::path> files;
  for (const auto& entry :
       fs::directory_iterator(fs::path(GS_SOURCE_DIR) / "configs/experiments")) {
    if (entry.path().extension() == ".toml") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

class ExperimentFile : public ::testing::TestWithParam<fs::path> {
 protected:
  /// A copy of the file in a tree that has a folder for each scene that the files name: the photo
  /// sets themselves are not part of the repository.
  fs::path in_a_tree_with_scenes() {
    for (const char* scene :
         {"shared/data/fox_640", "shared/data/fox_1080", "shared/data/south_building",
          "shared/data/suzanne_dynamic", "shared/data/lego", "shared/data/bonsai",
          "gemsplat/out/film_scene", "gemsplat/out/film_scene_20", "gemsplat/examples/courtyard"}) {
      fs::create_directories(temp_.path() / scene);
    }
    for (const char* scene :  // of the wide bench: docs/lab/scenes.md
         {"bonsai",     "trex",     "herzjesu25", "castle19", "seneca",   "kitchen", "dtu24",
          "dancer",     "flower",   "can",        "bear",     "castle30", "dtu65",   "lego",
          "redkitchen", "corridor", "fountain11", "terrace",  "aerial",   "family",  "chair",
          "ship",       "fern",     "plush",      "desk",     "entry10",  "dtu37",   "corridor2"})
      fs::create_directories(temp_.path() / "gemsplat/out/scenes" / scene);
    const fs::path folder = temp_.path() / "gemsplat/configs/experiments";
    fs::create_directories(folder);
    fs::copy_file(GetParam(), folder / GetParam().filename());
    return folder / GetParam().filename();
  }

 private:
  TempFolder temp_;
};

TEST_P(ExperimentFile, HasValidSettingsInEveryRun) {
  const Experiment experiment = read_experiment(in_a_tree_with_scenes());
  ASSERT_FALSE(experiment.configs.empty());
  for (const ExperimentScene& scene : experiment.scenes) {
    for (const ExperimentConfig& config : experiment.configs) {
      for (const std::uint64_t seed : experiment.seeds) {
        EXPECT_NO_THROW(settings_of(experiment, scene, config, seed))
            << scene.name << ", " << config.name;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, ExperimentFile, ::testing::ValuesIn(experiment_files()),
                         [](const auto& info) { return info.param.stem().string(); });

}  // namespace
}  // namespace gs
