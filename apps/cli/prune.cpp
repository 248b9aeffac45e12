// SPDX-License-Identifier: Apache-2.0
// gemsplat prune: removes Gaussians that contribute little from a trained model, and reports what
// that costs in PSNR.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>
#include <numeric>

#include "apps/cli/devices.h"
#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "gs_app/edit/contributions.h"
#include "gs_app/export/export_model.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/results.h"
#include "gs_app/run/text.h"
#include "gs_core/error.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/system/text/json.h"
#include "gs_core/threads/parallel.h"
#include "gs_eval/metrics.h"
#include "gs_model/edit/model_transform.h"
#include "gs_model/edit/select.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_train/density/floaters.h"

namespace gs {
namespace {

struct PruneCommand : CommandLine {
  std::string model, output;
  std::optional<int> step;
  float opacity = 0, contribution = 0;
  double keep = 1;  // share of the Gaussians that the other rules leave
  float clearance = 0;
  int witnesses = 1;
  std::vector<double> box;  // x y z of two corners, in the photos' frame; empty: no box
  bool json = false, force = false, allow_empty = false;

  bool removes_rows() const {
    return opacity > 0 || contribution > 0 || keep < 1 || clearance > 0 || !box.empty();
  }
};

/// How many Gaussians each rule removed, of those that the rules before it had left.
struct Removed {
  std::size_t outside = 0, faint = 0, unseen = 0, floaters = 0;
};

/// The rows that are still there.
class Kept {
 public:
  explicit Kept(std::size_t count) : rows_(count) { std::iota(rows_.begin(), rows_.end(), 0u); }
  /// Removes rows and returns how many.
  template <class F>
  std::size_t remove(F&& is_removed) {
    return std::erase_if(rows_, is_removed);
  }
  /// Keeps the `count` rows with the largest scores, of equal ones the first; returns how many go.
  std::size_t keep_best(std::size_t count, const std::vector<float>& score) {
    std::vector<float> of_kept;
    for (const std::uint32_t row : rows_) of_kept.push_back(score[row]);
    std::vector<std::uint32_t> best;
    for (const std::uint32_t k : rows_with_largest(of_kept, count)) best.push_back(rows_[k]);
    rows_.swap(best);
    return best.size() - rows_.size();
  }
  const std::vector<std::uint32_t>& rows() const { return rows_; }

 private:
  std::vector<std::uint32_t> rows_;
};

/// Everything that is decided before the first Gaussian is removed.
struct Pruning {
  const PruneCommand& command;
  const GaussianModel& model;
  const Gaussians& gaussians;  // the model's, in the renderer's memory
  Renderer& renderer;
  const Scene& scene;
  const RenderSettings& settings;
};

std::vector<Camera> cameras_of(const std::vector<View>& views) {
  std::vector<Camera> cameras;
  for (const View& view : views) cameras.push_back(view.camera);
  return cameras;
}

// Applies the rules one after another, in the order of Removed.
Removed apply_rules(const Pruning& p, Kept& kept) {
  const PruneCommand& command = p.command;
  const Gaussians& host = p.model.gaussians;
  Removed removed;
  if (const std::vector<double>& c = command.box; !c.empty()) {
    const Box box = box_between({c[0], c[1], c[2]}, {c[3], c[4], c[5]});
    removed.outside = kept.remove(
        [&](std::size_t i) { return !box.holds(Vec3d(host.mean[i]) + p.model.world_offset); });
  }
  if (command.opacity > 0)
    removed.faint = kept.remove(
        [&](std::size_t i) { return sigmoid(host.logit_opacity[i]) < command.opacity; });
  std::vector<float> shares;
  if (command.contribution > 0 || command.keep < 1)
    shares = contributions_of(p.renderer, p.gaussians.span(), cameras_of(p.scene.train_views),
                              p.settings, !command.quiet)
                 .largest;
  if (command.contribution > 0)
    removed.unseen = kept.remove([&](std::size_t i) { return shares[i] < command.contribution; });
  if (command.clearance > 0) {
    const FloaterFinder finder(p.scene, command.clearance, command.witnesses);
    const std::vector<std::uint8_t> is_floater = finder.marks(host.mean.download());
    removed.floaters = kept.remove([&](std::size_t i) { return is_floater[i]; });
  }
  if (command.keep < 1)
    removed.unseen += kept.keep_best(
        std::size_t(std::llround(command.keep * double(kept.rows().size()))), shares);
  return removed;
}

void check_not_empty(const PruneCommand& command, const Kept& kept, const Removed& removed) {
  if (!kept.rows().empty() || command.allow_empty) return;
  throw UsageError(fmt::format(
      "nothing would be left: {} Gaussians are outside, {} faint, {} hardly seen, {} floaters; "
      "choose lower limits or a larger box, or add --allow-empty to write a model without "
      "Gaussians",
      with_commas(removed.outside), with_commas(removed.faint), with_commas(removed.unseen),
      with_commas(removed.floaters)));
}

Json json_of(std::size_t gaussians, const Evaluation& evaluation) {
  return {{"num_gaussians", gaussians}, {"psnr", evaluation.psnr}, {"ssim", evaluation.ssim}};
}

/// A model and how it does on the views.
struct Measured {
  std::size_t gaussians;
  Evaluation evaluation;
};

void print_json(const PruneCommand& command, const OpenedModel& opened, const char* split,
                const Removed& removed, const Measured& before, const Measured& after) {
  const Json json = {{"model", opened.ply.string()},
                     {"output", command.output},
                     {"split", split},
                     {"removed",
                      {{"outside", removed.outside},
                       {"faint", removed.faint},
                       {"unseen", removed.unseen},
                       {"floaters", removed.floaters}}},
                     {"before", json_of(before.gaussians, before.evaluation)},
                     {"after", json_of(after.gaussians, after.evaluation)}};
  std::cout << json.dump(2, ' ', false, Json::error_handler_t::replace) << "\n";
}

void print_text(const PruneCommand& command, const char* split, const Removed& removed,
                const Measured& before, const Measured& after) {
  std::cout << fmt::format(
      "{} of {} Gaussians removed: {} outside, {} faint, {} hardly seen, {} floaters\n"
      "{} views before: {}\n{} views after:  {}\n{}\n",
      with_commas(before.gaussians - after.gaussians), with_commas(before.gaussians),
      with_commas(removed.outside), with_commas(removed.faint), with_commas(removed.unseen),
      with_commas(removed.floaters), split, summary(before.evaluation), split,
      summary(after.evaluation), command.output);
}

void prune(const PruneCommand& command) {
  setup_log(command.verbosity());
  if (!command.removes_rows() && !command.has("model.sh_degree"))
    throw UsageError(
        "there is no rule to prune by; give --opacity, --contribution, --keep, --floaters, --box "
        "or --sh-degree");
  check_export({command.output}, command.force);
  OpenedModel opened = open_model(command.model, command.step);
  if (!opened.run) opened.config.dataset.eval = true;
  const Config config = resolve(command, opened.config);
  set_thread_count(config.train.threads);
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  const Scene scene = scene_for(opened, config.dataset, command.has("dataset.source"));
  const RenderSettings settings = settings_of_model(opened, config);
  const char* split = scene.test_views.empty() ? "training" : "test";
  const auto measured = [&](const Gaussians& gaussians) {
    const auto& views = scene.test_views.empty() ? scene.train_views : scene.test_views;
    return Measured{gaussians.count(),
                    evaluate(backend->renderer(), gaussians.span(), views, settings)};
  };

  const Gaussians gaussians = copy_to(backend->memory(), opened.model);
  const Measured before = measured(gaussians);
  Kept kept(gaussians.count());
  const Removed removed =
      apply_rules({command, opened.model, gaussians, backend->renderer(), scene, settings}, kept);
  check_not_empty(command, kept, removed);
  GaussianModel result = rows_of(opened.model, kept.rows());
  limit_sh_degree(result, config.model.sh_degree);
  const Measured after = measured(copy_to(backend->memory(), result));
  ExportRequest request{command.output};
  request.input_from_model = opened.input_from_model;
  export_model(result, request);
  if (command.json)
    print_json(command, opened, split, removed, before, after);
  else
    print_text(command, split, removed, before, after);
}

}  // namespace

void add_prune(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand(
      "prune", "Remove Gaussians that contribute little, and report the loss in PSNR");
  const auto command = std::make_shared<PruneCommand>();
  verb.add_option("model", command->model,
                  "a run's folder, or with --data a model in any format that gemsplat reads")
      ->type_name("RUN|MODEL")
      ->required();
  verb.add_option("-o,--output", command->output,
                  "file to write; its ending chooses the format (docs/reference/formats.md)")
      ->type_name("FILE")
      ->required();
  verb.add_option("--iteration", command->step,
                  "which model of a run: the one saved after this step [the newest]")
      ->type_name("STEP");
  verb.add_option("--opacity", command->opacity, "remove Gaussians with a lower opacity")
      ->type_name("0..1")
      ->check(CLI::Range(0.0, 1.0));
  verb.add_option(
          "--contribution", command->contribution,
          "remove Gaussians that contribute less than this many pixels to every training view")
      ->type_name("PIXELS")
      ->check(CLI::NonNegativeNumber);
  verb.add_option("--keep", command->keep,
                  "keep this share of the Gaussians that the other rules leave: those that "
                  "contribute most to some training view")
      ->type_name("SHARE")
      ->check(CLI::Range(0.0, 1.0));
  verb.add_option("--floaters", command->clearance,
                  "remove Gaussians that a photo looks through: they are nearer than this share of "
                  "the depth of the scene points around them, as density.camera_clearance says")
      ->type_name("SHARE")
      ->check(CLI::NonNegativeNumber);
  verb.add_option("--witnesses", command->witnesses,
                  "with --floaters: spare a Gaussian that this many training photos show "
                  "among their own scene points [1]")
      ->type_name("VIEWS")
      ->check(CLI::PositiveNumber);
  verb.add_option("--box", command->box,
                  "remove Gaussians outside of a box, given by two opposite corners in the "
                  "coordinates of the photos' poses")
      ->type_name("X Y Z X Y Z")
      ->expected(6);
  verb.add_flag("--json", command->json, "print JSON");
  verb.add_flag("--force", command->force, "if the file exists, move it to FILE.bak-N first");
  verb.add_flag("--allow-empty", command->allow_empty,
                "write the model even if no Gaussian is left");
  add_dataset_options(verb, *command, "-d,--data,-s,--source-path");
  add_render_options(verb, *command, "highest SH degree in the file");
  add_general_options(verb, *command);
  verb.callback([command] { prune(*command); });
}

}  // namespace gs
