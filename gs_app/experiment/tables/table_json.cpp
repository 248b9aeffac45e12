// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/table_json.h"

#include "gs_app/experiment/tables/table_settings.h"
#include "gs_app/run/provenance.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"

namespace gs {
namespace {

Json scene_json(const SceneRow& scene) {
  Json json = {{"name", scene.name},
               {"path", scene.path},
               {"settings", scene.settings},
               {"views", Json::array()}};
  for (const auto& [views, configs] : scene.variants)
    json["views"].push_back({{"configs", configs},
                             {"scene_hash", views.scene_hash},
                             {"train_views", views.train_views},
                             {"test_views", views.test_views},
                             {"size", views.size}});
  return json;
}

Json number_or_null(const std::optional<double>& value) {
  return value ? Json(*value) : Json(nullptr);
}

Json spread_json(const Spread& spread) {
  return {{"mean", spread.mean}, {"standard_deviation", number_or_null(spread.deviation)}};
}

Json group_json(const Group& group) {
  Json json = {{"scene", group.scene},
               {"config", group.config},
               {"finished", group.rows.size()},
               {"runs", group.wanted}};
  for (const Metric& metric : all_metrics())
    if (const auto spread = spread_of(group, metric)) json[metric.key] = spread_json(*spread);
  return json;
}

Json mean_json(const SceneMean& mean) {
  Json json = {{"config", mean.config}, {"finished", mean.seeds.size()}, {"seeds", mean.wanted}};
  for (const Metric& metric : all_metrics())
    if (const auto spread = spread_of(mean, metric)) json[metric.key] = spread_json(*spread);
  return json;
}

Json difference_json(const Comparison& comparison) {
  Json json = {{"config", comparison.config},
               {"scene", comparison.scene.empty() ? Json(nullptr) : Json(comparison.scene)},
               {"finished", comparison.pairs.size()},
               {"pairs", comparison.wanted}};
  for (const Metric& metric : all_metrics())
    if (const auto difference = difference_of(comparison, metric))
      json[metric.key] = {{"mean", difference->mean},
                          {"standard_error", number_or_null(difference->standard_error)}};
  return json;
}

Json run_json(const RunRow& row) {
  return {{"scene", row.run->scene},
          {"config", row.run->config},
          {"seed", row.run->seed},
          {"state", row.state},
          {"folder", row.run->folder.root().string()},
          {"settings", settings_json(row.run->settings)},
          {"results", row.results}};
}

}  // namespace

std::string experiment_json(const Experiment& experiment, const std::vector<SceneRow>& scenes,
                            const std::vector<RunRow>& rows, const std::vector<Group>& groups,
                            const std::vector<SceneMean>& means,
                            const std::vector<Comparison>& comparisons,
                            const Provenance& provenance) {
  Json json = {{"experiment", experiment.file.string()},
               {"version", kVersion},
               {"commit", built_commit()},
               {"date", utc_date()},
               {"provenance", provenance_json(provenance)}};
  for (const char* key : {"scenes", "configs", "summary", "scene_means"}) json[key] = Json::array();
  json["baseline"] = experiment.baseline.empty() ? Json(nullptr) : Json(experiment.baseline);
  for (const char* key : {"differences", "runs"}) json[key] = Json::array();
  for (const SceneRow& scene : scenes) json["scenes"].push_back(scene_json(scene));
  for (const ExperimentConfig& config : experiment.configs)
    json["configs"].push_back(
        {{"name", config.name}, {"settings", settings_json(experiment, config)}});
  for (const Group& group : groups) json["summary"].push_back(group_json(group));
  for (const SceneMean& mean : means) json["scene_means"].push_back(mean_json(mean));
  for (const Comparison& comparison : comparisons)
    json["differences"].push_back(difference_json(comparison));
  for (const RunRow& row : rows) json["runs"].push_back(run_json(row));
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace gs
