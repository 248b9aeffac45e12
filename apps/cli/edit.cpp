// SPDX-License-Identifier: Apache-2.0
// gemsplat edit: crops, merges, moves and shrinks trained models. Operations apply in the order in
// which they stand on the command line.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <map>
#include <memory>

#include "apps/cli/help_format.h"
#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/photos/photos.h"
#include "gs_app/blocks/merge_blocks.h"
#include "gs_app/edit/edit_picture.h"
#include "gs_app/edit/edit_step.h"
#include "gs_app/edit/merge_models.h"
#include "gs_app/export/export_model.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/results.h"
#include "gs_app/run/text.h"
#include "gs_core/error.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/files/output_names.h"
#include "gs_core/system/text/json.h"
#include "gs_core/threads/parallel.h"
#include "gs_eval/metrics.h"
#include "gs_render/render_settings.h"

namespace gs {
namespace {

struct EditCommand : CommandLine {
  const CLI::App* verb = nullptr;
  std::vector<std::string> inputs, block_runs;
  std::string output, cameras, picture, picture_view;
  std::map<std::string, std::vector<std::string>> values;  // of each kind of operation, in order
  std::string about = "0,0,0", plane = "xz", decimate_by = "merge", antialiased;
  std::optional<int> step;
  int lod_level = 0;
  ExportOptions options;
  bool whole = false, as_stored = false, measure = false, dry_run = false, json = false,
       force = false;

  /// Whether the input is what `gemsplat partition` has written.
  bool has_blocks() const { return inputs.size() == 1 && is_partition(inputs.front()); }
};

// The operations in the order in which they stand.
std::vector<EditStep> steps_of(const EditCommand& command) {
  const std::vector<double> about = numbers_of_list(command.about, 3, "--about");
  const EditOptions options{{about[0], about[1], about[2]},
                            {polygon_plane(command.plane), command.whole},
                            command.decimate_by == "merge"};
  std::map<std::string, std::size_t> used;
  std::vector<EditStep> steps;
  for (const CLI::Option* option : command.verb->parse_order()) {
    const auto values = command.values.find(option->get_name().substr(2));
    if (values == command.values.end()) continue;
    const std::size_t n = used[values->first]++;
    const bool is_flag = values->second.empty();
    steps.push_back(edit_step(values->first, is_flag ? "" : values->second.at(n), options));
  }
  return steps;
}

// The picture is a PNG, and not the model that is written.
void check_picture(const EditCommand& command) {
  if (lowercase_ending(command.picture) != ".png")
    throw UsageError("--picture " + command.picture +
                     ": the picture is a PNG; name a file that ends in .png");
  check_place(command.picture, command.force);
  OutputNames names;
  if (!command.output.empty() && !command.dry_run) {
    names.add_file(command.output);
    names.add_file(sidecar_of(command.output));
  }
  names.add_file(command.picture);
}

void check(const EditCommand& command, const std::vector<EditStep>& steps) {
  if (steps.empty() && command.inputs.size() < 2 && !command.has_blocks())
    throw UsageError(
        "there is nothing to do; give operations, such as --keep opacity=0.1.., or several models "
        "or the blocks of a partition to merge");
  if (!command.block_runs.empty() && !command.has_blocks())
    throw UsageError("--run names a run of a block; give the folder of its partition as MODEL");
  if (command.output.empty() && !command.dry_run)
    throw UsageError("there is no file to write; name it with -o, or give --dry-run");
  if (!command.output.empty() && !command.dry_run)
    check_export({command.output, command.options}, command.force);
  if (!command.picture.empty()) check_picture(command);
  if (!command.picture_view.empty() && command.picture.empty())
    throw UsageError("--picture-view goes with --picture FILE.png");
}

bool any_of(const std::vector<EditStep>& steps, bool EditStep::*wish) {
  return std::any_of(steps.begin(), steps.end(), [&](const EditStep& s) { return s.*wish; });
}

// The cameras that go with one of the models; none where they are not known.
std::vector<EditCamera> cameras_of(const EditCommand& command, const Config& config,
                                   const std::optional<RunFolder>& run, const EditModel& model) {
  if (!command.cameras.empty()) return cameras_to_edit(command.cameras, model);
  if (command.has("dataset.source")) return cameras_to_edit(config.dataset, model);
  if (run && std::filesystem::exists(run->cameras())) return cameras_to_edit(*run, model);
  return {};
}

/// All models as one, with what is known of each.
struct Opened {
  EditModel model;
  Config config;                 // that of the first
  std::optional<RunFolder> run;  // of the first
  Json inputs = Json::array();
};

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
Opened open_blocks(const EditCommand& command, bool with_cameras) {
  const BlockRuns runs{{command.block_runs.begin(), command.block_runs.end()}, command.step};
  MergedBlocks merged = merge_blocks(read_blocks(command.inputs.front()), runs);
  Opened result{std::move(merged.model), resolve(command), {}};
  for (const BlockShare& share : merged.shares)
    result.inputs.push_back({{"file", share.run.string()},
                             {"block", share.name},
                             {"gaussians", share.gaussians},
                             {"kept", share.owned}});
  if (with_cameras) result.model.cameras = cameras_of(command, result.config, {}, result.model);
  return result;
}

Opened open_all(const EditCommand& command, bool with_cameras) {
  if (command.has_blocks()) return open_blocks(command, with_cameras);
  Opened result;
  std::vector<NamedModel> models;
  bool cameras_are_shared = false;
  for (const std::string& input : command.inputs) {
    OpenedModel opened = open_model(input, command.step, command.lod_level);
    const Config config = resolve(command, opened.config);
    if (models.empty()) result.config = config, result.run = opened.run;
    if (!models.empty() && !command.as_stored && !command.has("dataset.source"))
      warn_of_two_scenes(command.inputs.front(), result.config, input, config);
    result.inputs.push_back(
        {{"file", opened.ply.string()}, {"gaussians", opened.model.gaussians.count()}});
    const std::optional<RunFolder> run = opened.run;
    models.push_back({opened.ply.string(), model_to_edit(std::move(opened))});
    if (with_cameras && !cameras_are_shared)
      models.back().model.cameras = cameras_of(command, config, run, models.back().model);
    cameras_are_shared = !command.cameras.empty() || command.has("dataset.source");
  }
  MergeOptions options{command.as_stored, {}};
  if (!command.antialiased.empty()) options.antialiased = command.antialiased == "yes";
  result.model = merge_models(std::move(models), options);
  return result;
}

RenderSettings settings_of_pictures(const GaussianModel& model, Config config) {
  config.model.sh_degree = model.sh_degree;
  config.render.antialias = model.antialiased;
  RenderSettings settings = render_settings(config);
  settings.for_backward = false;
  return settings;
}

std::string line_of(const std::string& text, std::size_t count, const std::string& note) {
  return fmt::format("{:<40} {:>12}{}\n", text, with_commas(count),
                     note.empty() ? "" : "   " + note);
}

std::string line_of(const StepReport& report) {
  std::string note = report.note;
  if (report.after < report.before)
    note = fmt::format("{} fewer{}{}", with_commas(report.before - report.after),
                       note.empty() ? "" : ", ", note);
  return line_of(report.text, report.after, note);
}

/// What --measure compares: a model on the views that were held out, or without any on the others.
struct Measured {
  std::string split;
  std::size_t gaussians;
  Evaluation evaluation;
};

Measured measured(const EditSession& session, const Config& config) {
  const GaussianModel model = in_photos_frame(session.model);
  const Scene& scene = session.tools.scene(model.world_offset);
  const bool has_test = !scene.test_views.empty();
  Backend& backend = session.tools.backend();
  const Gaussians gaussians = copy_to(backend.memory(), model);
  return {has_test ? "test" : "training", gaussians.count(),
          evaluate(backend.renderer(), gaussians.span(),
                   has_test ? scene.test_views : scene.train_views,
                   settings_of_pictures(model, config))};
}

Json json_of(const Measured& measured) {
  return {{"num_gaussians", measured.gaussians},
          {"psnr", measured.evaluation.psnr},
          {"ssim", measured.evaluation.ssim}};
}

Json json_of(const StepReport& report) {
  Json json = {{"step", report.text}, {"before", report.before}, {"after", report.after}};
  if (!report.note.empty()) json["note"] = report.note;
  return json;
}

std::optional<ExportedFile> write(const EditCommand& command, const EditModel& model) {
  if (command.dry_run) return {};
  ExportRequest request{command.output, command.options};
  request.input_from_model = model.input_from_model;
  return export_model(model.model, request);
}

/// The model before and after all steps; empty where --measure does not ask.
using Comparison = std::vector<Measured>;

void print_json(const EditCommand& command, const Json& inputs,
                const std::vector<StepReport>& reports, const EditModel& model,
                const std::optional<ExportedFile>& written, const Comparison& compared) {
  Json steps = Json::array();
  for (const StepReport& report : reports) steps.push_back(json_of(report));
  Json json = {{"inputs", inputs},
               {"steps", steps},
               {"gaussians", model.model.gaussians.count()},
               {"sh_degree", model.model.sh_degree},
               {"was_moved", model.input_from_model.has_value()}};
  if (written) json["output"] = written->file.string(), json["bytes"] = written->bytes;
  if (!command.picture.empty()) json["picture"] = command.picture;
  if (!compared.empty())
    json["measured"] = {{"split", compared[0].split},
                        {"before", json_of(compared[0])},
                        {"after", json_of(compared[1])}};
  std::cout << json.dump(2, ' ', false, Json::error_handler_t::replace) << "\n";
}

bool wants_cameras(const EditCommand& command, const std::vector<EditStep>& steps) {
  return any_of(steps, &EditStep::needs_cameras) || any_of(steps, &EditStep::likes_cameras) ||
         !command.picture_view.empty();
}

// The photos. A model without a run does not say which views were held out; the usual rule applies.
Scene scene_of(const EditCommand& command, const Opened& opened, const Vec3d& offset) {
  DatasetConfig dataset = opened.config.dataset;
  if (!opened.run) dataset.eval = true;
  return scene_for(opened.run ? &*opened.run : nullptr, dataset, command.has("dataset.source"),
                   offset);
}

void check_format(const EditCommand& command, const GaussianModel& model) {
  if (command.output.empty()) return;
  const bool has_time = model.gaussians.has_time && command.values.at("time").empty();
  check_holds(format_to_write(command.output), has_time, command.output);
}

// Applies all steps and prints a line for each.
std::vector<StepReport> apply_all(const std::vector<EditStep>& steps, EditSession& session,
                                  bool says) {
  std::vector<StepReport> reports;
  for (const EditStep& step : steps) {
    reports.push_back(apply_step(session, step));
    if (says) std::cout << line_of(reports.back()) << std::flush;
  }
  return reports;
}

void write_picture(const std::string& file, const Image8& picture) {
  keep_older_aside(file);
  write_png(file, picture);
}

void edit(const EditCommand& command) {
  setup_log(command.verbosity());
  const std::vector<EditStep> steps = steps_of(command);
  std::optional<OutputLock> lock;  // of the picture; that of the model is taken when it is written
  if (!command.picture.empty()) lock.emplace(OutputLock::of_file(command.picture));
  check(command, steps);
  Opened opened = open_all(command, wants_cameras(command, steps));
  set_thread_count(opened.config.train.threads);
  check_format(command, opened.model.model);

  std::unique_ptr<Backend> backend;  // made when something is rendered
  EditSession session{std::move(opened.model), {}};
  session.tools = {[&]() -> Backend& {
                     if (!backend) backend = make_backend(opened.config.train.device);
                     return *backend;
                   },
                   settings_of_pictures(session.model.model, opened.config), !command.quiet};
  std::optional<Scene> scene;  // read when something asks for it
  session.tools.scene = [&](const Vec3d& offset) -> Scene& {
    if (!scene) scene = scene_of(command, opened, offset);
    bring_to_offset(*scene, offset);
    return *scene;
  };
  std::optional<EditPicture> picture;
  if (!command.picture.empty()) picture.emplace(session.model, session.tools, command.picture_view);

  const bool says = !command.quiet && !command.json;
  const std::size_t inputs = command.inputs.size();
  if (says)
    std::cout << line_of(command.has_blocks()
                             ? fmt::format("{} blocks merged", opened.inputs.size())
                         : inputs == 1 ? command.inputs[0]
                                       : fmt::format("{} models merged", inputs),
                         session.model.model.gaussians.count(), "");
  Comparison compared;
  if (command.measure) compared.push_back(measured(session, opened.config));
  const std::vector<StepReport> reports = apply_all(steps, session, says);
  if (command.measure) compared.push_back(measured(session, opened.config));
  const std::optional<ExportedFile> written = write(command, session.model);
  if (picture) write_picture(command.picture, picture->beside(session.model));
  if (command.json) print_json(command, opened.inputs, reports, session.model, written, compared);
  for (std::size_t i = 0; says && i < compared.size(); ++i)
    std::cout << fmt::format("{} views {} {}\n", compared[i].split,
                             i == 0 ? "before:" : "after: ", summary(compared[i].evaluation));
  if (says) std::cout << (written ? summary(*written, nullptr) : "nothing is written") << "\n";
}

void add_operations(CLI::App& verb, EditCommand& command) {
  for (const EditStepKind& kind : edit_step_kinds()) {
    std::vector<std::string>& values = command.values[kind.name];
    CLI::Option& option = kind.values.empty()
                              ? *verb.add_flag("--" + kind.name, kind.meaning)
                              : *verb.add_option("--" + kind.name, values, kind.meaning)
                                     ->type_name(kind.values)
                                     ->expected(1)
                                     ->allow_extra_args(false)
                                     ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
    option.group("Operations, in the order in which they are given");
  }
}

constexpr std::size_t kMeaningColumn = 27;

// What --keep and --drop take, for the end of the help.
std::string selections_text() {
  const std::size_t width = help_width();
  std::string text =
      wrapped("What --keep and --drop take (ranges may lack an end: 0.1.. or ..0.1):", 0, 0,
              width) +
      "\n";
  for (const SelectionKind& kind : selection_kinds()) {
    if (kind.meaning.empty()) continue;
    const std::string form = kind.values.empty() ? kind.name : kind.name + "=" + kind.values;
    const std::string name = fmt::format("  {:<24} ", form);
    text += name + wrapped(kind.meaning, name.size(), kMeaningColumn, width) + "\n";
  }
  return text;
}

}  // namespace

void add_edit(CLI::App& program) {
  CLI::App& verb =
      *program.add_subcommand("edit", "Crop, merge, move, straighten and shrink trained models");
  const auto command = std::make_shared<EditCommand>();
  command->verb = &verb;
  verb.add_option("model", command->inputs,
                  "models in any format that gemsplat reads, or runs' folders; several are merged "
                  "first, in the frame of the first one; or the folder of a partition, whose "
                  "trained blocks are merged")
      ->type_name("MODEL|RUN")
      ->required();
  verb.add_option("-o,--output", command->output,
                  "file to write; its ending chooses the format: " + format_names())
      ->type_name("FILE");
  verb.add_option("--iteration", command->step,
                  "which model of a run: the one saved after this step [the newest]")
      ->type_name("STEP");
  add_level_option(verb, command->lod_level);
  add_operations(verb, *command);
  verb.add_option("--about", command->about,
                  "the point that --turn, --scale and --up leave where it is [0,0,0]")
      ->type_name("X,Y,Z");
  verb.add_option("--plane", command->plane,
                  "the two axes of the plane of polygons: xz is the floor of a straightened model, "
                  "xy that of a map [xz]")
      ->type_name("AXES");
  verb.add_flag("--whole", command->whole,
                "a Gaussian is in a box, sphere, polygon or range of coordinates if all of it is, "
                "to three standard deviations [its mean counts]");
  verb.add_option("--decimate-by", command->decimate_by,
                  "merge: merge near and similar Gaussians; drop: drop those that contribute least "
                  "to the training views [merge]")
      ->check(CLI::IsMember({"merge", "drop"}))
      ->type_name("HOW");
  verb.add_option("--run", command->block_runs,
                  "of a partition: a block's run that was trained elsewhere than by its "
                  "experiment; its settings name the block; may be repeated")
      ->type_name("RUN")
      ->expected(1)
      ->take_all();
  verb.add_flag("--as-stored", command->as_stored,
                "merge the numbers of the files as they stand, whatever their sidecars say of "
                "their frames");
  verb.add_option("--antialiased", command->antialiased,
                  "whether merged models are rendered antialiased, if they do not agree")
      ->check(CLI::IsMember({"yes", "no"}))
      ->type_name("yes|no");
  verb.add_option("--cameras", command->cameras,
                  "cameras.json, transforms.json or COLMAP model instead of the run's cameras")
      ->type_name("FILE");
  verb.add_option("--picture", command->picture,
                  "write a picture of the model before and after, side by side")
      ->type_name("FILE.png");
  verb.add_option("--picture-view", command->picture_view,
                  "the camera of that picture [one outside of the model]")
      ->type_name("NAME");
  verb.add_flag("--measure", command->measure,
                "print PSNR and SSIM of the held-out views before and after; with the photos of "
                "the run or of --data");
  verb.add_flag("--dry-run", command->dry_run,
                "print the number of Gaussians after each operation, and write no model");
  verb.add_flag("--json", command->json, "print JSON");
  verb.add_flag("--force", command->force, "if a file exists, move it to FILE.bak-N first");
  add_camera_options(verb, *command, "-d,--data,-s,--source-path");
  add_general_options(verb, *command);
  verb.footer(selections_text());
  verb.callback([command] { edit(*command); });
}

}  // namespace gs
