// SPDX-License-Identifier: Apache-2.0
// results.json of an experiment: all that is known of its runs. Its Markdown, its CSV
// (experiment_views.h) and its report (gs_app/report/report_experiment.h) are made from it.
#pragma once

#include <optional>
#include <vector>

#include "gs_app/experiment/experiment_run.h"
#include "gs_app/run/provenance.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// {"experiment", "version", "commit", "date", "provenance", "scenes", "configs", "summary",
/// "scene_means", "baseline", "differences", "runs"}:
/// - "scenes": "name", "path", "settings" (all of the scene's own, also those at their defaults,
///   because they override those of the configs) and "views" (views_json());
/// - "configs": "name" and "settings", those that differ from the defaults, without those of scenes;
/// - "summary": "scene", "config", "finished" and "runs", and {"mean", "standard_deviation"} over
///   seeds of each metric;
/// - "scene_means": "config", "finished" and "seeds", and the same of the means over scenes, of seeds
///   whose runs have finished in every scene; empty for a single scene;
/// - "differences" to the config "baseline" (null: there is none): "config", "scene" (null for all),
///   "finished" and "pairs", and {"mean", "standard_error"} of the differences between runs of the
///   same scene and seed, so that what these do to both cancels;
/// - "runs": "scene", "config", "seed", "state", "folder", "settings" and "results" (null unless it
///   is finished). A run without results is "failed" if `failed` holds its index, or "missing".
Json experiment_json(const Experiment& experiment, const std::vector<ExperimentRun>& runs,
                     const std::vector<std::size_t>& failed);

/// The command, build and uncommitted changes that an experiment's tables come from:
/// {"command": [...], "folder", "version", "commit", "compiler", "cuda", "uncommitted": {"hash",
/// "files": [...], "diff"}}. "cuda" is null in a build without CUDA, "uncommitted" where there is
/// nothing or nothing is known.
Json provenance_json(const std::optional<UncommittedChanges>& uncommitted);

/// The results of a run. Null if the file is missing or damaged. Throws AccessError if it cannot be
/// read now.
Json results_of(const ExperimentRun& run);

}  // namespace gs
