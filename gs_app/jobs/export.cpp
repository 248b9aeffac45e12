// SPDX-License-Identifier: Apache-2.0
// gemsplat export: a trained model in the formats of viewers, and what each format costs.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <utility>

#include "gs_app/export/cameras.h"
#include "gs_app/export/export_model.h"
#include "gs_app/jobs/export/export_job.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/text.h"
#include "gs_app/view/page/model_page.h"
#include "gs_core/system/files/output_lock.h"

namespace gs {
namespace {

bool is_any_lossy(const std::vector<ExportRequest>& requests, int sh_degree) {
  return std::any_of(requests.begin(), requests.end(),
                     [&](const ExportRequest& request) { return is_lossy(request, sh_degree); });
}

// The views of a split of --data or of the run; none where that has no such split.
std::vector<NamedCamera> views_of(const ExportJob& job, const OpenedModel& opened,
                                  const Config& config, const std::string& split) {
  const Vec3d& offset = opened.model.world_offset;
  const bool has_scene = job.has("dataset.source");
  const bool has_cameras = opened.run && std::filesystem::exists(opened.run->cameras());
  const bool has_split = opened.run && std::filesystem::exists(opened.run->split());
  if (has_scene) return cameras_of_scene(config.dataset, split, offset);
  if (has_cameras && (has_split || split == "all"))
    return cameras_of_run(*opened.run, 1, split, offset);
  return {};
}

// The cameras of a split, or all where there is none.
std::vector<Camera> cameras_of(const ExportJob& job, const OpenedModel& opened,
                               const Config& config, const std::string& wanted, bool& is_all) {
  std::vector<Camera> cameras;
  for (const std::string& split : {wanted, std::string("all")}) {
    is_all = split == "all";
    for (const NamedCamera& one : views_of(job, opened, config, split))
      cameras.push_back(one.camera);
    if (!cameras.empty()) break;
  }
  return cameras;
}

Json json_of(const ExportedFile& file) {
  Json json = {{"file", file.file.string()},
               {"format", file.format->name},
               {"gaussians", file.gaussians},
               {"bytes", file.bytes}};
  if (file.fidelity) json["psnr"] = file.fidelity->psnr, json["ssim"] = file.fidelity->ssim;
  return json;
}

/// Says what was written as soon as it was.
struct Written {
  JobEvents& events;
  Outcome outcome = {"", {{"files", Json::array()}}};

  void add(const std::string& text, const Json& json) {
    events.say(text);
    outcome.json["files"].push_back(json);
  }
};

void write_files(const ExportJob& job, const std::vector<ExportRequest>& requests,
                 const GaussianModel& model, const Viewpoints* viewpoints, Written& written) {
  std::vector<ExportedFile> files;
  for (const ExportRequest& request : requests) {
    try {
      files.push_back(export_model(model, request, viewpoints));
    } catch (const Error& error) {
      if (!job.table || error.code() != ExitCode::bad_data) throw;
      log_warning("{} is left out: {}", request.file.string(), error.what());
      continue;
    }
    written.add(summary(files.back(), viewpoints) + "\n", json_of(files.back()));
  }
  if (!job.table) return;
  const std::string table = export_table(files);
  const OutputLock lock = OutputLock::of_file(table_file(job.outputs[0]));
  keep_older_aside(table_file(job.outputs[0]));
  write_text(table_file(job.outputs[0]), table);
  written.outcome.text = "\n" + table;
  written.outcome.is_answer = true;
}

void write_tilesets(const std::vector<TilesetRequest>& tilesets, const GaussianModel& model,
                    Written& written) {
  for (const TilesetRequest& request : tilesets) {
    const ExportedTileset tileset = export_tileset(model, request);
    written.add(summary(tileset, request.georeference) + "\n", {{"file", tileset.folder.string()},
                                                                {"format", "3D Tiles"},
                                                                {"gaussians", tileset.gaussians},
                                                                {"bytes", tileset.bytes}});
  }
}

void write_pages(const ExportJob& job, const std::vector<std::filesystem::path>& pages,
                 const OpenedModel& opened, const Config& config, Written& written) {
  for (const std::filesystem::path& file : pages) {
    const ModelPage page =
        write_model_page(file, opened, config, config.model.sh_degree, job.title);
    written.add(summary(page) + "\n", {{"file", page.file.string()},
                                       {"format", "page"},
                                       {"gaussians", page.gaussians},
                                       {"bytes", page.bytes}});
  }
}

// A page opens by itself; other files are shown by `view`, and tilesets by programs of maps.
NextCommand next_of(const ExportJob& job, const Json& files) {
  const std::string& first = job.outputs.front();
  if (is_page(job, first)) return {"open it", "xdg-open " + shell_word(first)};
  if (is_tileset(job, first) || files.empty())
    return {"look at the model", "gemsplat view " + shell_word(job.model)};
  const std::string shown = job.table ? files[0].at("file").get<std::string>() : first;
  return {"look at it", "gemsplat view " + shell_word(shown)};
}

// Measures the loss of lossy files, too.
void write_measured(const ExportJob& job, const std::vector<ExportRequest>& requests,
                    const OpenedModel& opened, const Config& config, Written& written) {
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  const Gaussians gaussians = copy_to(backend->memory(), opened.model);
  Viewpoints viewpoints{*backend, gaussians.span(), settings_of_model(opened, config), {}};
  bool is_all;
  viewpoints.cameras = cameras_of(job, opened, config, "test", is_all);
  if (is_all) viewpoints.what = "all {} views";
  if (viewpoints.cameras.empty())
    log_info(
        "the loss of lossy formats is not measured: there are no views; give --data SCENE, or "
        "export a run");
  viewpoints.training = [&] { return cameras_of(job, opened, config, "train", is_all); };
  write_files(job, requests, opened.model, &viewpoints, written);
}

}  // namespace

Outcome run(ExportJob job, JobEvents& events) {
  OpenedModel opened = open_model(job.model, job.choice.step);
  if (job.time) take_moment(opened, *job.time);
  const Config config = resolve_to_work(job, opened.config);
  ExportOutputs outputs = outputs_of(job, opened, config);
  for (ExportRequest& request : outputs.files)
    if (format_to_write(request.file).takes_views && !opened.input_from_model)
      for (const NamedCamera& view : views_of(job, opened, config, "all"))
        request.options.views.push_back({view.name, moved(view.camera, request.transform)});
  Written written{events};
  write_tilesets(outputs.tilesets, opened.model, written);
  write_pages(job, outputs.pages, opened, config, written);
  if (job.unmeasured || !is_any_lossy(outputs.files, opened.model.sh_degree))
    write_files(job, outputs.files, opened.model, nullptr, written);
  else
    write_measured(job, outputs.files, opened, config, written);
  written.outcome.next = {next_of(job, written.outcome.json["files"])};
  return written.outcome;
}

Verb export_verb() {
  return verb_of<ExportJob>("export", VerbGroup::change, "Write a trained model in other formats",
                            {"export out/scene", "export out/scene scene.sog page.html",
                             "export out/scene formats --table"});
}

}  // namespace gs
