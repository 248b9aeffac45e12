// SPDX-License-Identifier: Apache-2.0
// What gemsplat edit changes: one model, several ones merged, or the blocks of a partition.
#include <spdlog/fmt/fmt.h>

#include "gs_app/blocks/merge_blocks.h"
#include "gs_app/edit/edit_cameras.h"
#include "gs_app/jobs/edit/edit_job.h"
#include "gs_model/edit/merge_models.h"

namespace gs {
namespace {

// The cameras that go with one of the models; none where they are not known.
std::vector<EditCamera> cameras_of(const EditJob& job, const Config& config,
                                   const std::optional<RunFolder>& run, const EditModel& model) {
  if (!job.cameras.empty()) return cameras_to_edit(job.cameras, model);
  if (job.has("dataset.source")) return cameras_to_edit(config.dataset, model);
  if (run && std::filesystem::exists(run->cameras())) return cameras_to_edit(*run, model);
  return {};
}

/// Models of one scene share a frame; those of two have nothing to do with each other.
void warn_of_two_scenes(const std::string& first, const Config& first_config,
                        const std::string& other, const Config& config) {
  const auto scene_of = [](const Config& c) {
    std::error_code ignored;
    return std::filesystem::weakly_canonical(c.dataset.source, ignored);
  };
  if (first_config.dataset.source.empty() || config.dataset.source.empty() ||
      scene_of(first_config) == scene_of(config))
    return;
  log_warning(
      "{} was trained on {}, and {} on {}: places of two scenes have nothing to do with each "
      "other; place one of them with --move, --turn and --scale, and merge them with --as-stored",
      first, first_config.dataset.source, other, config.dataset.source);
}

/// The trained blocks of a partition as one model.
EditInputs open_blocks(const EditJob& job, bool with_cameras) {
  const BlockRuns runs{{job.block_runs.begin(), job.block_runs.end()}, job.choice.step};
  MergedBlocks merged = merge_blocks(read_blocks(job.inputs.front()), runs);
  EditInputs result{std::move(merged.model), resolve(job), {}};
  for (const BlockShare& share : merged.shares)
    result.described.push_back({{"file", share.run.string()},
                                {"block", share.name},
                                {"gaussians", share.gaussians},
                                {"kept", share.owned}});
  if (with_cameras) result.model.cameras = cameras_of(job, result.config, {}, result.model);
  return result;
}

}  // namespace

EditInputs open_inputs(const EditJob& job, bool with_cameras) {
  if (job.has_blocks()) return open_blocks(job, with_cameras);
  EditInputs result;
  std::vector<NamedModel> models;
  bool cameras_are_shared = false;
  for (const std::string& input : job.inputs) {
    OpenedModel opened = open_model(input, job.choice.step);
    const Config config = resolve(job, opened.config);
    if (models.empty()) result.config = config, result.run = opened.run;
    if (!models.empty() && !job.as_stored && !job.has("dataset.source"))
      warn_of_two_scenes(job.inputs.front(), result.config, input, config);
    result.described.push_back(
        {{"file", opened.ply.string()}, {"gaussians", opened.model.gaussians.count()}});
    const std::optional<RunFolder> run = opened.run;
    models.push_back({opened.ply.string(), model_to_edit(std::move(opened))});
    if (with_cameras && !cameras_are_shared)
      models.back().model.cameras = cameras_of(job, config, run, models.back().model);
    cameras_are_shared = !job.cameras.empty() || job.has("dataset.source");
  }
  MergeOptions options{job.as_stored, {}};
  if (!job.antialiased.empty()) options.antialiased = job.antialiased == "yes";
  result.model = merge_models(std::move(models), options);
  return result;
}

std::string name_of_inputs(const EditJob& job, const EditInputs& inputs) {
  if (job.has_blocks()) return fmt::format("{} blocks merged", inputs.described.size());
  if (job.inputs.size() == 1) return job.inputs.front();
  return fmt::format("{} models merged", job.inputs.size());
}

}  // namespace gs
