// SPDX-License-Identifier: Apache-2.0
// gemsplat prune: a trained model without the Gaussians that it can do without, and what that costs.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>

#include "apps/cli/devices.h"
#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "data_loaders/formats/coding/finite_rows.h"
#include "gs_app/export/exported_file.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/progress_bar.h"
#include "gs_app/run/results.h"
#include "gs_app/run/text.h"
#include "gs_core/error.h"
#include "gs_core/math/activations.h"
#include "gs_core/parallel.h"
#include "gs_train/contribution.h"
#include "gs_train/floaters.h"
#include "gs_train/metrics.h"

namespace gs {
namespace {

struct PruneCommand : CommandLine {
  std::string model, output;
  std::optional<int> step;
  float opacity = 0, contribution = 0;
  float clearance = 0;
  int witnesses = 0;
  std::vector<double> box;  // x y z of two corners, in the frame of the photos' poses; empty: everywhere
  bool json = false, force = false;
};

struct Removed {
  std::size_t outside = 0, faint = 0, unseen = 0, floaters = 0;  // each counts what those before it have left
};

/// Rows that stay; what is removed is counted once.
class Kept {
 public:
  explicit Kept(std::size_t count) : rows_(count) { std::iota(rows_.begin(), rows_.end(), 0u); }
  template <class F>
  std::size_t remove(F&& is_removed) {
    return std::erase_if(rows_, is_removed);
  }
  const std::vector<std::uint32_t>& rows() const { return rows_; }

 private:
  std::vector<std::uint32_t> rows_;
};

// (N) the largest share in any view.   pixels
std::vector<float> largest_shares(Renderer& renderer, const GaussiansSpan& gaussians,
                                  const std::vector<View>& views, const RenderSettings& settings,
                                  bool show_progress) {
  std::vector<float> largest(gaussians.mean.size);
  ContributionMeter meter(renderer, gaussians, settings);
  ProgressBar bar(std::int64_t(views.size()), show_progress);
  std::int64_t done = 0;
  for (const View& view : views) {
    const std::vector<float>& shares = meter.measure(view.camera);
    for (std::size_t i = 0; i < largest.size(); ++i) largest[i] = std::max(largest[i], shares[i]);
    if (bar.due(++done)) bar.draw(done, "contributions", "view");
  }
  bar.clear();
  return largest;
}

bool is_inside(const std::vector<double>& box, const Vec3d& point) {
  for (int axis = 0; axis < 3; ++axis) {
    const auto [low, high] = std::minmax(box[axis], box[3 + axis]);
    if (!(point[axis] >= low && point[axis] <= high)) return false;
  }
  return true;
}

void reduce_sh_degree(GaussianModel& model, int degree) {
  if (degree >= model.sh_degree) return;
  model.sh_degree = degree;
  for (ShRest& rest : model.gaussians.sh_rest)
    std::fill(rest.coefficient + sh_rest_count(degree), std::end(rest.coefficient), Vec3f(0));
}

void prune(const PruneCommand& command) {
  setup_log(command.verbosity());
  if (!(command.opacity > 0 || command.contribution > 0 || command.clearance > 0) &&
      command.box.empty() && !command.has("model.sh_degree"))
    throw UsageError(
        "prune what? give --opacity, --contribution, --floaters, --box or --sh-degree");
  const ExportRequest request{command.output, {}, {}};
  check_export(request, command.force);
  OpenedModel opened = open_model(command.model, command.step);
  if (!opened.run) opened.config.dataset.eval = true;
  const Config config = resolve(command, opened.config);
  set_thread_count(config.train.threads);
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  const Scene scene = scene_for(opened, config.dataset, command.has("dataset.source"));
  const RenderSettings settings = view_settings(opened, opened.config);
  const std::vector<View>& measured =
      scene.test_views.empty() ? scene.train_views : scene.test_views;
  const auto quality = [&](const Gaussians& gaussians) {  // of a lower SH degree all others are 0
    return evaluate(backend->renderer(), gaussians.span(), measured, settings);
  };

  const GaussianModel& model = opened.model;
  const Gaussians gaussians = copy_to(backend->memory(), model);
  const Evaluation before = quality(gaussians);
  Kept kept(gaussians.count());
  Removed removed;
  if (!command.box.empty())
    removed.outside = kept.remove([&](std::size_t i) {
      return !is_inside(command.box, Vec3d(model.gaussians.mean[i]) + model.world_offset);
    });
  removed.faint = kept.remove(
      [&](std::size_t i) { return sigmoid(model.gaussians.logit_opacity[i]) < command.opacity; });
  if (command.contribution > 0) {
    const std::vector<float> shares = largest_shares(backend->renderer(), gaussians.span(),
                                                     scene.train_views, settings, !command.quiet);
    removed.unseen = kept.remove([&](std::size_t i) { return shares[i] < command.contribution; });
  }
  if (command.clearance > 0) {
    const std::vector<std::uint8_t> is_floater =
        find_floaters(backend->renderer(), gaussians.span(), model.gaussians.mean.download(), scene,
                      settings, command.clearance, command.witnesses);
    if (!is_floater.empty())
      removed.floaters = kept.remove([&](std::size_t i) { return is_floater[i]; });
  }
  GaussianModel result = rows_of(model, kept.rows());
  reduce_sh_degree(result, config.model.sh_degree);
  const Evaluation after = quality(copy_to(backend->memory(), result));
  export_model(result, request, nullptr);

  const char* split = scene.test_views.empty() ? "training" : "test";
  if (command.json) {
    std::cout << nlohmann::ordered_json{{"model", opened.ply.string()},
                                        {"output", command.output},
                                        {"split", split},
                                        {"removed",
                                         {{"outside", removed.outside},
                                          {"faint", removed.faint},
                                          {"unseen", removed.unseen},
                                          {"floaters", removed.floaters}}},
                                        {"before",
                                         {{"num_gaussians", gaussians.count()},
                                          {"psnr", before.psnr},
                                          {"ssim", before.ssim}}},
                                        {"after",
                                         {{"num_gaussians", result.gaussians.count()},
                                          {"psnr", after.psnr},
                                          {"ssim", after.ssim}}}}
                     .dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace)
              << "\n";
    return;
  }
  std::cout << fmt::format(
      "{} of {} Gaussians removed: {} outside, {} faint, {} hardly seen, {} floaters\n"
      "{} views before: {}\n{} views after:  {}\n{}\n",
      with_commas(gaussians.count() - result.gaussians.count()), with_commas(gaussians.count()),
      with_commas(removed.outside), with_commas(removed.faint), with_commas(removed.unseen),
      with_commas(removed.floaters), split, summary(before), split, summary(after), command.output);
}

}  // namespace

void add_prune(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand(
      "prune", "Remove Gaussians that a trained model can do without, and say what that costs");
  const auto command = std::make_shared<PruneCommand>();
  verb.add_option("model", command->model, "a run's folder, or a PLY with --data")
      ->type_name("RUN|PLY")
      ->required();
  verb.add_option("-o,--output", command->output,
                  "the model without them, in the format of its name (docs/formats.md)")
      ->type_name("FILE")
      ->required();
  verb.add_option("--iteration", command->step,
                  "of a run, the model saved after that step [the newest]")
      ->type_name("STEP");
  verb.add_option("--opacity", command->opacity, "remove those that are fainter")
      ->type_name("0..1")
      ->check(CLI::Range(0.0, 1.0));
  verb.add_option("--contribution", command->contribution,
                  "remove those that no training view shows more of than so many pixels")
      ->type_name("PIXELS")
      ->check(CLI::NonNegativeNumber);
  verb.add_option("--floaters", command->clearance,
                  "remove those nearer to a camera than that share of the way to what it sees, as "
                  "training does with density.camera_clearance")
      ->type_name("SHARE")
      ->check(CLI::NonNegativeNumber);
  verb.add_option("--witnesses", command->witnesses,
                  "but those that so many views see from farther away; 0, the default: them, too")
      ->type_name("VIEWS")
      ->check(CLI::NonNegativeNumber);
  verb.add_option("--box", command->box,
                  "remove those outside: two opposite corners, in the frame of the photos' poses")
      ->type_name("X Y Z X Y Z")
      ->expected(6);
  verb.add_flag("--json", command->json, "print JSON");
  verb.add_flag("--force", command->force, "keep a file of that name as FILE.bak-N");
  add_dataset_options(verb, *command, "-d,--data,-s,--source-path");
  add_render_options(verb, *command);
  add_general_options(verb, *command);
  verb.callback([command] { prune(*command); });
}

}  // namespace gs
