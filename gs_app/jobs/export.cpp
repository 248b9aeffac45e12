// SPDX-License-Identifier: Apache-2.0
// gemsplat export: a trained model in the formats of viewers, and what each format costs.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "data_loaders/georef/georef_file.h"
#include "gs_app/export/cameras.h"
#include "gs_app/export/export_model.h"
#include "gs_app/jobs/export_job.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/text.h"
#include "gs_app/view/page/model_page.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/files/output_names.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

ModelTransform transform_of(const ExportJob& job, const GaussianModel& model) {
  ModelTransform transform;
  if (job.recenter) transform.center = median_mean(model);
  if (!job.up.empty()) {
    const Vec3d up{job.up[0], job.up[1], job.up[2]};
    if (!is_finite(up) || up == Vec3d(0.0)) throw UsageError("--up has no direction");
    transform.turn = turn_upright(up);
  }
  if (!std::isfinite(job.scale)) throw UsageError("--scale is no number");
  transform.scale = job.scale;
  return transform;
}

/// Where the model's scene stands on earth, if that is known.
std::optional<Georeference> georeference_of(const ExportJob& job, const Config& config) {
  if (!job.georef.empty()) return read_georef(job.georef);
  const std::string& scene = config.dataset.source;
  if (scene.empty() || !std::filesystem::exists(georef_file_of(scene))) return {};
  return read_georef(georef_file_of(scene));
}

/// What must stay where it is while the folders of outputs are made.
std::vector<std::filesystem::path> inputs_of(const ExportJob& job, const Config& config) {
  std::vector<std::filesystem::path> inputs =
      inputs_of(static_cast<const JobSettings&>(job), config);
  inputs.insert(inputs.end(), {job.model, job.georef});
  return inputs;
}

/// An output that ends in / is the folder of a tileset.
bool is_tileset(const ExportJob& job, const std::string& output) {
  return !job.table && output.ends_with('/');
}

/// An output that ends in .html is the viewer's page with the model inside.
bool is_page(const ExportJob& job, const std::string& output) {
  return !job.table && is_model_page(output);
}

std::vector<std::filesystem::path> pages_of(const ExportJob& job, OutputNames& names) {
  std::vector<std::filesystem::path> pages;
  for (const std::string& output : job.outputs) {
    if (!is_page(job, output)) continue;
    if (job.recenter || !job.up.empty() || job.scale != 1)
      throw UsageError(
          "--recenter, --up and --scale move the model, and a page has the cameras of the run "
          "beside it; leave them out, or export a moved model first, and then its page");
    check_model_page(output, job.force);
    names.add_file(output);
    pages.emplace_back(output);
  }
  if (!job.title.empty() && pages.empty())
    throw UsageError("--title is what a page is called, and no output ends in .html");
  return pages;
}

std::vector<TilesetRequest> tilesets_of(const ExportJob& job, const Config& config,
                                        const std::optional<Georeference>& georeference,
                                        OutputNames& names) {
  std::vector<TilesetRequest> tilesets;
  for (const std::string& output : job.outputs) {
    if (!is_tileset(job, output)) continue;
    if (!georeference)
      throw UsageError(output +
                       " is to be a tileset, which stands on earth, and nothing says where: run "
                       "`gemsplat georef SCENE` first, or name its file with --georef FILE");
    if (job.recenter || !job.up.empty() || job.scale != 1)
      throw UsageError(
          "--recenter, --up and --scale move the model, and a tileset stands where the scene is; "
          "leave them out");
    tilesets.push_back({std::filesystem::path(output).parent_path(), *georeference,
                        config.model.sh_degree, job.tile_gaussians, inputs_of(job, config)});
    check_tileset(tilesets.back(), job.force);
    names.add_folder(tilesets.back().folder);
  }
  return tilesets;
}

std::filesystem::path table_file(const std::string& folder) {
  return std::filesystem::path(folder) / "formats.md";
}

// The files of --table: one in each format that this build writes and that holds the model.
std::vector<std::string> files_of_table(const std::string& folder, const ExportOptions& options,
                                        const GaussianModel& model) {
  std::vector<std::string> files;
  for (const ModelFormat& format : model_formats()) {
    if (!holds(format, model.gaussians.has_time)) continue;
    try {
      format.require(options);
      files.push_back(folder + "/model" + std::string(format.ending));
    } catch (const Error& missing) {
      log_warning("{} is left out: {}", format.name, missing.what());
    }
  }
  return files;
}

std::vector<ExportRequest> requests_of(const ExportJob& job, const OpenedModel& opened,
                                       int sh_degree,
                                       const std::optional<Georeference>& georeference,
                                       OutputNames& names) {
  const GaussianModel& model = opened.model;
  const ModelTransform transform = transform_of(job, model);
  std::vector<ExportRequest> requests;
  if (job.table && job.outputs.size() != 1)
    throw UsageError("--table takes one folder, in which it writes a file of each format");
  for (const std::string& file :
       job.table ? files_of_table(job.outputs[0], job.options, model) : job.outputs)
    if (!is_tileset(job, file) && !is_page(job, file))
      requests.push_back(
          {file, job.options, transform, sh_degree, opened.input_from_model, georeference});
  for (const ExportRequest& request : requests) {
    check_export(request, job.force);
    check_holds(format_to_write(request.file), model.gaussians.has_time, request.file.string());
    names.add_file(request.file);
    names.add_file(sidecar_of(request.file));
  }
  if (job.table) check_place(table_file(job.outputs[0]), job.force);
  return requests;
}

bool is_any_lossy(const std::vector<ExportRequest>& requests, int sh_degree) {
  return std::any_of(requests.begin(), requests.end(),
                     [&](const ExportRequest& request) { return is_lossy(request, sh_degree); });
}

// The test views of --data or of the run, or all views where there are no test views.
std::vector<NamedCamera> cameras_of(const ExportJob& job, const OpenedModel& opened,
                                    const Config& config, const char*& what) {
  std::vector<NamedCamera> cameras;
  const Vec3d& offset = opened.model.world_offset;
  const bool has_scene = job.has("dataset.source");
  const bool has_cameras = opened.run && std::filesystem::exists(opened.run->cameras());
  const bool has_split = opened.run && std::filesystem::exists(opened.run->split());
  for (const auto& [split, words] : {std::pair{"test", "{} test views"}, {"all", "all {} views"}}) {
    what = words;
    if (has_scene)
      cameras = cameras_of_scene(config.dataset, split, offset);
    else if (has_cameras && (has_split || split != std::string_view("test")))
      cameras = cameras_of_run(*opened.run, 1, split, offset);
    if (!cameras.empty()) return cameras;
  }
  log_info(
      "the loss of lossy formats is not measured: there are no views; give --data SCENE, or export "
      "a run");
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
std::vector<NextCommand> next_of(const ExportJob& job) {
  const std::string& first = job.outputs.front();
  if (is_page(job, first)) return {{"open it", "xdg-open " + shell_word(first)}};
  if (is_tileset(job, first) || job.table) return {};
  return {{"look at it", "gemsplat view " + shell_word(first)}};
}

}  // namespace

Outcome run(const ExportJob& job, JobEvents& events) {
  OpenedModel opened = open_model(job.model, job.choice.step);
  if (job.time) take_moment(opened, *job.time);
  const Config config = resolve(job, opened.config);
  set_thread_count(config.train.threads);
  const int sh_degree = config.model.sh_degree;
  const std::optional<Georeference> georeference = georeference_of(job, config);
  Written written{events};
  written.outcome.next = next_of(job);
  OutputNames names;
  const std::vector<ExportRequest> requests =
      requests_of(job, opened, sh_degree, georeference, names);
  const std::vector<TilesetRequest> tilesets = tilesets_of(job, config, georeference, names);
  const std::vector<std::filesystem::path> pages = pages_of(job, names);
  write_tilesets(tilesets, opened.model, written);
  write_pages(job, pages, opened, config, written);
  const auto write = [&](const Viewpoints* viewpoints) {
    write_files(job, requests, opened.model, viewpoints, written);
    return written.outcome;
  };
  if (job.unmeasured || !is_any_lossy(requests, opened.model.sh_degree)) return write(nullptr);
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  const Gaussians gaussians = copy_to(backend->memory(), opened.model);
  Viewpoints viewpoints{*backend, gaussians.span(), settings_of_model(opened, config), {}};
  for (const NamedCamera& named : cameras_of(job, opened, config, viewpoints.what))
    viewpoints.cameras.push_back(named.camera);
  return write(&viewpoints);
}

Verb export_verb() {
  return verb_of<ExportJob>("export", VerbGroup::change, "Write a trained model in other formats",
                            {"export out/scene scene.spz scene.sog", "export out/scene page.html",
                             "export out/scene formats --table"});
}

}  // namespace gs
