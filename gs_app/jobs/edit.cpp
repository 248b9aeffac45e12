// SPDX-License-Identifier: Apache-2.0
// gemsplat edit: crops, merges, moves and shrinks trained models. Operations apply in the order in
// which they stand on the command line.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <memory>

#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_app/edit/edit_picture.h"
#include "gs_app/export/export_model.h"
#include "gs_app/jobs/edit/edit_job.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/output_place.h"
#include "gs_app/run/results.h"
#include "gs_app/run/text.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/files/output_names.h"
#include "gs_core/threads/parallel.h"
#include "gs_eval/metrics.h"
#include "gs_render/render_settings.h"

namespace gs {
namespace {

// The operations in the order in which they stand.
std::vector<EditStep> steps_of(const EditJob& job) {
  const std::vector<double> about = numbers_of_list(job.about, 3, "--about");
  const EditOptions options{{about[0], about[1], about[2]},
                            {polygon_plane(job.plane), job.whole},
                            job.decimate_by == "merge"};
  std::vector<EditStep> steps;
  for (const auto& [name, value] : job.operations) steps.push_back(edit_step(name, value, options));
  return steps;
}

// The picture is a PNG, and not the model that is written.
void check_picture(const EditJob& job) {
  if (lowercase_ending(job.picture) != ".png")
    throw UsageError("--picture " + job.picture +
                     ": the picture is a PNG; name a file that ends in .png");
  check_place(job.picture, job.force);
  OutputNames names;
  if (!job.output.empty() && !job.dry_run) {
    names.add_file(job.output);
    names.add_file(sidecar_of(job.output));
  }
  names.add_file(job.picture);
}

void check_wish(const EditJob& job, const std::vector<EditStep>& steps) {
  if (steps.empty() && job.inputs.size() < 2 && !job.has_blocks())
    throw UsageError(
        "there is nothing to do; give operations, such as --keep opacity=0.1.., or several models "
        "or the blocks of a partition to merge");
  if (!job.block_runs.empty() && !job.has_blocks())
    throw UsageError("--run names a run of a block; give the folder of its partition as MODEL");
  if (!job.picture_view.empty() && job.picture.empty())
    throw UsageError("--picture-view goes with --picture FILE.png");
}

// Beside the first model, and in its format where that can be written.
std::string usual_output(const EditJob& job) {
  const std::string& input = job.inputs.front();
  const ModelFormat* const own = find_format(input);
  const bool keeps_format = own && own->write && !job.was_given("--time");
  const std::string ending(keeps_format ? own->ending : ".ply");
  const bool is_merged = job.has_blocks() || job.inputs.size() > 1;
  return new_place(beside(input, is_merged ? "-merged" : "-edited"),
                   {ending, sidecar_of(ending).string()})
      .string();
}

void check_outputs(const EditJob& job) {
  if (!job.output.empty() && !job.dry_run) check_export({job.output, job.options}, job.force);
  if (!job.picture.empty()) check_picture(job);
}

bool any_of(const std::vector<EditStep>& steps, bool EditStep::*wish) {
  return std::any_of(steps.begin(), steps.end(), [&](const EditStep& s) { return s.*wish; });
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

std::optional<ExportedFile> write(const EditJob& job, const EditModel& model) {
  if (job.dry_run) return {};
  ExportRequest request{job.output, job.options};
  request.input_from_model = model.input_from_model;
  return export_model(model.model, request);
}

bool wants_cameras(const EditJob& job, const std::vector<EditStep>& steps) {
  return any_of(steps, &EditStep::needs_cameras) || any_of(steps, &EditStep::likes_cameras) ||
         !job.picture_view.empty();
}

// The photos. A model without a run does not say which views were held out; the usual rule applies.
Scene scene_of(const EditJob& job, const EditInputs& opened, const Vec3d& offset) {
  DatasetConfig dataset = opened.config.dataset;
  if (!opened.run) dataset.eval = true;
  return scene_for(opened.run ? &*opened.run : nullptr, dataset, job.has("dataset.source"), offset);
}

void check_format(const EditJob& job, const GaussianModel& model) {
  if (job.output.empty()) return;
  const bool has_time = model.gaussians.has_time && !job.was_given("--time");
  check_holds(format_to_write(job.output), has_time, job.output);
}

/// The model before and after all steps; empty where --measure does not ask.
using Comparison = std::vector<Measured>;

Json json_of(const EditJob& job, const Json& inputs, const std::vector<StepReport>& reports,
             const EditModel& model, const std::optional<ExportedFile>& written,
             const Comparison& compared) {
  Json steps = Json::array();
  for (const StepReport& report : reports) steps.push_back(json_of(report));
  Json json = {{"inputs", inputs},
               {"steps", steps},
               {"gaussians", model.model.gaussians.count()},
               {"sh_degree", model.model.sh_degree},
               {"was_moved", model.input_from_model.has_value()}};
  if (written) json["output"] = written->file.string(), json["bytes"] = written->bytes;
  if (!job.picture.empty()) json["picture"] = job.picture;
  if (!compared.empty())
    json["measured"] = {{"split", compared[0].split},
                        {"before", json_of(compared[0])},
                        {"after", json_of(compared[1])}};
  return json;
}

// What is said at the end, after the lines of the steps.
std::string text_of(const Comparison& compared, const std::optional<ExportedFile>& written) {
  std::string text;
  for (std::size_t i = 0; i < compared.size(); ++i)
    text += fmt::format("{} views {} {}\n", compared[i].split,
                        i == 0 ? "before:" : "after: ", summary(compared[i].evaluation));
  return text + (written ? summary(*written, nullptr) : "nothing is written") + "\n";
}

// Applies all steps and says a line for each.
std::vector<StepReport> apply_all(const std::vector<EditStep>& steps, EditSession& session,
                                  JobEvents& events) {
  std::vector<StepReport> reports;
  for (const EditStep& step : steps) {
    reports.push_back(apply_step(session, step));
    events.say(line_of(reports.back()));
  }
  return reports;
}

void write_picture(const std::string& file, const Image8& picture) {
  keep_older_aside(file);
  write_png(file, picture);
}

NextCommand next_of(const EditJob& job, const std::optional<ExportedFile>& written) {
  if (written) return {"look at it", "gemsplat view " + shell_word(written->file.string())};
  if (job.has_blocks()) return {"merge them", "gemsplat edit " + shell_word(job.inputs.front())};
  return {"look at it as it is", "gemsplat view " + shell_word(job.inputs.front())};
}

}  // namespace

Outcome run(EditJob job, JobEvents& events) {
  const std::vector<EditStep> steps = steps_of(job);
  check_wish(job, steps);
  if (job.output.empty() && !job.dry_run) job.output = usual_output(job);
  std::optional<OutputLock> lock;  // of the picture; that of the model is taken when it is written
  if (!job.picture.empty()) lock.emplace(OutputLock::of_file(job.picture));
  check_outputs(job);
  EditInputs opened = open_inputs(job, wants_cameras(job, steps));
  set_thread_count(opened.config.train.threads);
  check_format(job, opened.model.model);

  std::unique_ptr<Backend> backend;  // made when something is rendered
  std::optional<Scene> scene;        // read when something asks for it
  EditSession session{std::move(opened.model), {}};
  session.tools = {[&]() -> Backend& {
                     if (!backend) backend = make_backend(opened.config.train.device);
                     return *backend;
                   },
                   settings_of_pictures(session.model.model, opened.config), !job.quiet,
                   [&](const Vec3d& offset) -> Scene& {
                     if (!scene) scene = scene_of(job, opened, offset);
                     bring_to_offset(*scene, offset);
                     return *scene;
                   }};
  std::optional<EditPicture> picture;
  if (!job.picture.empty()) picture.emplace(session.model, session.tools, job.picture_view);

  events.say(line_of(name_of_inputs(job, opened), session.model.model.gaussians.count(), ""));
  Comparison compared;
  if (job.measure) compared.push_back(measured(session, opened.config));
  const std::vector<StepReport> reports = apply_all(steps, session, events);
  if (job.measure) compared.push_back(measured(session, opened.config));
  const std::optional<ExportedFile> written = write(job, session.model);
  if (picture) write_picture(job.picture, picture->beside(session.model));
  Outcome outcome{text_of(compared, written),
                  json_of(job, opened.described, reports, session.model, written, compared)};
  outcome.next = {next_of(job, written)};
  return outcome;
}

Verb edit_verb() {
  return verb_of<EditJob>("edit", VerbGroup::change,
                          "Crop, merge, move, straighten and shrink trained models",
                          {"edit out/scene --straighten --keep box=-2,-2,-2,2,2,2 -o table.ply",
                           "edit out/scene --drop floaters=0.35 --measure -o clean.ply",
                           "edit out/scene --decimate 25%"});
}

}  // namespace gs
