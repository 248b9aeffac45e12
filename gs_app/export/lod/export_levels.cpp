// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/lod/export_levels.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/bake_filter.h"
#include "gs_core/config/text/markdown.h"
#include "gs_core/error.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/log.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/lod/rad.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr int kLeastSide = 32;  // pixels of a picture in which a level is measured

/// The model as the files are to hold it.
GaussianModel prepared(const GaussianModel& model, const LevelsRequest& request) {
  GaussianModel result = finite_model(model);
  bake_filter(result.gaussians);
  limit_sh_degree(result, request.sh_degree);
  transform_model(result, request.transform);
  return result;
}

/// The same viewpoints with pictures of 1/factor of their sides; nothing where these get too small.
std::optional<Viewpoints> reduced(const Viewpoints& viewpoints, int factor) {
  Viewpoints result = viewpoints;
  for (Camera& camera : result.cameras) {
    if (std::min(camera.width, camera.height) / factor < kLeastSide) return std::nullopt;
    camera = resized(camera, camera.width / factor, camera.height / factor);
  }
  return result;
}

void measure(ExportedLevels& exported, const LevelsRequest& request, const Viewpoints& viewpoints) {
  for (std::size_t k = 0; k < exported.levels.size(); ++k) {
    GaussianModel level = read_streamed_sog(exported.streamed.file, int(k));
    transform_model(level, inverse_of(request.transform));
    exported.levels[k].full = fidelity_of(level, viewpoints);
    if (const auto smaller = reduced(viewpoints, 1 << k))
      exported.levels[k].reduced = fidelity_of(level, *smaller);
  }
  exported.streamed.fidelity = exported.levels.front().full;
  GaussianModel leaves = read_rad(exported.rad.file);
  transform_model(leaves, inverse_of(request.transform));
  exported.rad.fidelity = fidelity_of(leaves, viewpoints);
}

ExportedFile described(const fs::path& file, const GaussianModel& model, const GaussianModel& whole,
                       const ModelTransform& transform) {
  const ModelFormat* const format = find_format(file);
  return {file,
          format,
          frames_of(*format, model, transform),
          whole.sh_degree,
          whole.antialiased,
          whole.gaussians.count()};
}

void write_sidecars(const ExportedLevels& exported) {
  write_sidecar(exported.streamed);
  write_sidecar(exported.rad);
}

std::string decibels(const std::optional<Fidelity>& fidelity) {
  return fidelity ? fmt::format("{:.2f}", fidelity->psnr) : "";
}

}  // namespace

void check_export_levels(const LevelsRequest& request, bool force) {
  for (const char* file : {kLodMeta, kLodRad}) find_format(file)->require({});
  std::error_code ignored;
  if (!fs::exists(fs::symlink_status(request.folder, ignored)) || is_empty_output(request.folder))
    return;
  if (!force)
    throw UsageError(
        fmt::format("{} is there already; choose another folder for --lod, or add --force to keep "
                    "it as {}.bak-N",
                    request.folder.string(), request.folder.filename().string()));
  check_may_move(request.folder, request.needed);
}

ExportedLevels export_levels(const GaussianModel& model, const LevelsRequest& request,
                             const Viewpoints* viewpoints) {
  const OutputLock lock = OutputLock::of_freed_folder(request.folder, request.needed);
  const GaussianModel whole = prepared(model, request);
  warn_of_left_out(request.folder, whole.gaussians.count(), model.gaussians.count());
  const LodTree tree = build_lod_tree(copy_of(whole.gaussians), request.lod);

  const fs::path meta = request.folder / kLodMeta, rad = request.folder / kLodRad;
  ExportedLevels exported{{},
                          described(meta, model, whole, request.transform),
                          described(rad, model, whole, request.transform)};
  write_rad(rad, splat_tree_of(tree), whole.sh_degree, whole.antialiased);
  exported.rad.bytes = fs::file_size(rad);
  for (const StreamedLevel& level :
       write_streamed_sog(request.folder, tree, {whole.sh_degree, whole.antialiased})) {
    exported.levels.push_back({level, {}, {}});
    exported.streamed.bytes += level.bytes;
  }
  exported.streamed.bytes += fs::file_size(meta);
  write_sidecars(exported);  // at once, as measuring may take minutes
  if (viewpoints && !viewpoints->cameras.empty()) {
    measure(exported, request, *viewpoints);
    write_sidecars(exported);
  }
  AtomicFile table(request.folder / "levels.md");
  table.write(levels_table(exported));
  table.commit();
  return exported;
}

std::string levels_table(const ExportedLevels& exported) {
  std::string table = markdown_header({"level", "Gaussians", "bytes", "share of the bytes in %",
                                       "PSNR in dB", "PSNR in dB at 1/2^level of the size"});
  for (std::size_t k = 0; k < exported.levels.size(); ++k) {
    const ExportedLevel& level = exported.levels[k];
    table += markdown_row(
        {fmt::format("{}", k), fmt::format("{}", level.written.gaussians),
         fmt::format("{}", level.written.bytes),
         fmt::format("{:.1f}", 100 * double(level.written.bytes) / double(exported.streamed.bytes)),
         decibels(level.full), decibels(level.reduced)});
  }
  table += "\n" + markdown_header({"file", "bytes", "bytes per Gaussian", "PSNR in dB"});
  for (const ExportedFile* file : {&exported.streamed, &exported.rad})
    table +=
        markdown_row({file->file.filename().string(), fmt::format("{}", file->bytes),
                      fmt::format("{:.1f}", file->bytes_per_gaussian()), decibels(file->fidelity)});
  return table;
}

}  // namespace gs
