// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/table_scenes.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <optional>

#include "gs_app/experiment/tables/table_settings.h"
#include "gs_core/error.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

// Of a file that a run wrote; what is wrong with it is not shown.
constexpr const char* kRemedyOfScenes = "train again";

// The most frequent picture size, and how many others there are.
std::string size_text(const Json& cameras) {
  std::map<std::pair<double, double>, int> counts;
  for (const Json& camera : cameras) ++counts[{camera.at("width"), camera.at("height")}];
  if (counts.empty()) return "";
  const auto most =
      std::max_element(counts.begin(), counts.end(),
                       [](const auto& a, const auto& b) { return a.second < b.second; });
  const std::string text = fmt::format("{}x{}", most->first.first, most->first.second);
  const std::size_t others = counts.size() - 1;
  if (others == 0) return text;
  return fmt::format("{} and {} other size{}", text, others, others == 1 ? "" : "s");
}

std::optional<SceneViews> views_of(const RunRow& row) {
  const std::filesystem::path split_file = row.run->folder.split();
  try {
    const Json split = read_json_as(split_file, kRemedyOfScenes);
    const Json cameras = read_json_as(row.run->folder.cameras(), kRemedyOfScenes);
    return take_from_json(split_file, kRemedyOfScenes, [&] {
      return SceneViews{row.results.value("scene_hash", ""), split.at("train").size(),
                        split.at("test").size(), size_text(cameras)};
    });
  } catch (const Error&) {
    return std::nullopt;
  }
}

void add_views(const SceneViews& views, const std::string& config, SceneRow& scene) {
  auto variant = std::find_if(scene.variants.begin(), scene.variants.end(),
                              [&](const SceneRow::Variant& each) { return each.views == views; });
  if (variant == scene.variants.end()) {
    scene.variants.push_back({views, {}});
    variant = scene.variants.end() - 1;
  }
  std::vector<std::string>& configs = variant->configs;
  if (std::find(configs.begin(), configs.end(), config) == configs.end()) configs.push_back(config);
}

}  // namespace

std::vector<SceneRow> scenes_of(const Experiment& experiment, const std::vector<RunRow>& rows) {
  std::vector<SceneRow> scenes;
  for (const ExperimentScene& scene : experiment.scenes) {
    scenes.push_back({scene.name, scene.path.string(), settings_json(scene), {}});
    for (const RunRow& row : rows) {
      if (row.run->scene != scene.name || row.results.is_null()) continue;
      if (const auto views = views_of(row)) add_views(*views, row.run->config, scenes.back());
    }
  }
  return scenes;
}

}  // namespace gs
