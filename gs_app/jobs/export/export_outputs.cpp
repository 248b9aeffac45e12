// SPDX-License-Identifier: Apache-2.0
// What gemsplat export writes: files of models, pages and tilesets, checked before the work.
#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "data_loaders/georef/georef_file.h"
#include "gs_app/jobs/export/export_job.h"
#include "gs_app/run/output_place.h"
#include "gs_app/view/page/model_page.h"
#include "gs_core/system/files/output_names.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

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
  if (scene.empty() || !fs::exists(georef_file_of(scene))) return {};
  return read_georef(georef_file_of(scene));
}

/// What must stay where it is while the folders of outputs are made.
std::vector<fs::path> inputs_of(const ExportJob& job, const Config& config) {
  std::vector<fs::path> inputs = inputs_of(static_cast<const JobSettings&>(job), config);
  inputs.insert(inputs.end(), {job.model, job.georef});
  return inputs;
}

bool moves_model(const ExportJob& job) { return job.recenter || !job.up.empty() || job.scale != 1; }

std::vector<fs::path> pages_of(const ExportJob& job, OutputNames& names) {
  std::vector<fs::path> pages;
  for (const std::string& output : job.outputs) {
    if (!is_page(job, output)) continue;
    if (moves_model(job))
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
    if (moves_model(job))
      throw UsageError(
          "--recenter, --up and --scale move the model, and a tileset stands where the scene is; "
          "leave them out");
    tilesets.push_back({fs::path(output).parent_path(), *georeference, config.model.sh_degree,
                        job.tile_gaussians, inputs_of(job, config)});
    check_tileset(tilesets.back(), job.force);
    names.add_folder(tilesets.back().folder);
  }
  return tilesets;
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
      requests.push_back({file, job.options, transform, sh_degree,
                          std::uint64_t(job.megabytes * 1e6), opened.input_from_model,
                          georeference});
  for (const ExportRequest& request : requests) {
    check_export(request, job.force);
    check_holds(format_to_write(request.file), model.gaussians.has_time, request.file.string());
    names.add_file(request.file);
    names.add_file(sidecar_of(request.file));
  }
  if (job.megabytes > 0 && requests.empty())
    throw UsageError(
        "--megabytes is for files of models; for a page or a tileset export a file of that size "
        "first, and then the page or tileset of it");
  if (job.table) check_place(table_file(job.outputs[0]), job.force);
  return requests;
}

// A model in space and time becomes a .gs4d, another one a .spz; what is one already becomes a .ply.
std::string usual_output(const ExportJob& job, bool has_time) {
  if (job.table) return new_place(beside(job.model, "-formats")).string();
  const ModelFormat* const own = find_format(job.model);
  std::string ending = has_time ? ".gs4d" : ".spz";
  if (own && own->ending == ending) ending = ".ply";
  return new_place(beside(job.model, ""), {ending, sidecar_of(ending).string()}).string();
}

}  // namespace

/// An output that ends in / is the folder of a tileset.
bool is_tileset(const ExportJob& job, const std::string& output) {
  return !job.table && output.ends_with('/');
}

/// An output that ends in .html is the viewer's page with the model inside.
bool is_page(const ExportJob& job, const std::string& output) {
  return !job.table && is_model_page(output);
}

fs::path table_file(const std::string& folder) { return fs::path(folder) / "formats.md"; }

ExportOutputs outputs_of(ExportJob& job, const OpenedModel& opened, const Config& config) {
  if (job.outputs.empty()) job.outputs = {usual_output(job, opened.model.gaussians.has_time)};
  const std::optional<Georeference> georeference = georeference_of(job, config);
  OutputNames names;
  ExportOutputs outputs;
  outputs.files = requests_of(job, opened, config.model.sh_degree, georeference, names);
  outputs.tilesets = tilesets_of(job, config, georeference, names);
  outputs.pages = pages_of(job, names);
  return outputs;
}

}  // namespace gs
