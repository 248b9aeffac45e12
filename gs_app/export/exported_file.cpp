// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/exported_file.h"

#include <spdlog/fmt/fmt.h>

#include <nlohmann/json.hpp>

#include "gs_app/run/open_model.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/config/markdown.h"
#include "gs_core/error.h"
#include "gs_core/io/move_aside.h"
#include "gs_core/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

Json rows_of(const Mat4d& matrix) {
  Json rows = Json::array();
  for (const auto& row : matrix.m) {
    Json numbers = Json::array();
    for (const double number : row) numbers.push_back(number + 0.0);  // no -0
    rows.push_back(numbers);
  }
  return rows;
}

// "x right, y down, z forward" are the PLY's, of a camera that looks along z.
Json axes_of(const AxisSigns& signs) {
  return {{"x", signs.x > 0 ? "right" : "left"},
          {"y", signs.y > 0 ? "down" : "up"},
          {"z", signs.z > 0 ? "forward" : "backward"}};
}

Json sidecar_json(const ExportedFile& exported, const GaussianModel& model,
                  const ModelTransform& transform) {
  const Mat4d file_from_train = multiply(diagonal(exported.format->signs), matrix_of(transform));
  const Mat4d input_from_train = translation(model.world_offset);
  const Mat4d input_from_file = multiply(input_from_train, inverse_of(file_from_train));
  Json json = {{"file", exported.file.filename().string()},
               {"format", exported.format->name},
               {"gaussians", exported.gaussians},
               {"bytes", exported.bytes},
               {"bytes_per_gaussian", exported.bytes_per_gaussian()},
               {"antialiased", model.antialiased},
               {"axes", axes_of(exported.format->signs)},
               {"input_from_file", rows_of(input_from_file)},
               {"file_from_input", rows_of(inverse_of(input_from_file))},
               {"input_from_train", rows_of(input_from_train)},
               {"train_from_input", rows_of(inverse_of(input_from_train))}};
  if (const auto& fidelity = exported.fidelity)
    json["fidelity"] = {
        {"psnr", fidelity->psnr}, {"ssim", fidelity->ssim}, {"num_views", fidelity->num_views}};
  return json;
}

GaussianModel copy_of(const GaussianModel& model) {
  GaussianModel copy{gs::copy_of(model.gaussians), model.sh_degree, model.is_ours,
                     model.antialiased, model.world_offset};
  return copy;
}

Fidelity measure(const ExportedFile& exported, const ModelTransform& transform,
                 const Viewpoints& viewpoints) {
  GaussianModel kept = exported.format->read(exported.file);
  place(kept, inverse_of(transform));
  return fidelity_of(kept, viewpoints);
}

std::string size_text(std::uint64_t bytes) {
  return bytes < 100'000 ? fmt::format("{:.1f} kB", double(bytes) / 1e3)
                         : fmt::format("{:.1f} MB", double(bytes) / 1e6);
}

}  // namespace

void check_place(const fs::path& file, bool force) {
  if (!fs::exists(file)) return;
  if (!force)
    throw UsageError(
        fmt::format("{} is there already; choose another name, or add --force to "
                    "keep it as {}.bak-N",
                    file.string(), file.filename().string()));
  if (!fs::is_regular_file(file))
    throw UsageError(file.string() + " is no file; choose another name");
}

void keep_older_aside(const fs::path& file) {
  if (fs::exists(file))
    log_info("the older {} is now {}", file.string(), keep_aside(file).string());
}

void check_export(const ExportRequest& request, bool force) {
  format_to_write(request.file).require(request.options);
  for (const fs::path& file : {request.file, sidecar_of(request.file)}) check_place(file, force);
}

ExportedFile export_model(const GaussianModel& model, const ExportRequest& request,
                          const Viewpoints* viewpoints) {
  keep_older_aside(request.file);
  keep_older_aside(sidecar_of(request.file));
  ExportedFile exported{request.file, &format_to_write(request.file), 0, 0, {}};
  if (request.transform.is_identity()) {
    exported.gaussians = write_model(request.file, model, request.options);
  } else {
    GaussianModel placed = copy_of(model);
    place(placed, request.transform);
    exported.gaussians = write_model(request.file, placed, request.options);
  }
  exported.bytes = fs::file_size(request.file);
  const bool is_measured = !exported.format->is_lossless && exported.format->read;
  if (is_measured && viewpoints && !viewpoints->cameras.empty())
    exported.fidelity = measure(exported, request.transform, *viewpoints);
  write_text(sidecar_of(request.file),
             sidecar_json(exported, model, request.transform)
                     .dump(2, ' ', false, Json::error_handler_t::replace) +
                 "\n");
  return exported;
}

std::string summary(const ExportedFile& exported, const Viewpoints* viewpoints) {
  std::string text = fmt::format("{}: {}, {:.1f} bytes per Gaussian", exported.file.string(),
                                 size_text(exported.bytes), exported.bytes_per_gaussian());
  if (const auto& fidelity = exported.fidelity)
    text += fmt::format("; {:.2f} dB PSNR, {:.4f} SSIM against the model on {} {} views",
                        fidelity->psnr, fidelity->ssim, fidelity->num_views, viewpoints->what);
  return text;
}

std::string export_table(const std::vector<ExportedFile>& files) {
  std::string table =
      markdown_header({"format", "holds", "bytes", "bytes per Gaussian", "PSNR in dB", "SSIM"});
  for (const ExportedFile& file : files) {
    const auto& fidelity = file.fidelity;
    table += markdown_row({std::string(file.format->name), std::string(file.format->holds),
                           fmt::format("{}", file.bytes),
                           fmt::format("{:.1f}", file.bytes_per_gaussian()),
                           fidelity ? fmt::format("{:.2f}", fidelity->psnr) : "",
                           fidelity ? fmt::format("{:.4f}", fidelity->ssim) : ""});
  }
  return table;
}

}  // namespace gs
