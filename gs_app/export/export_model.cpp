// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/export_model.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <utility>

#include "gs_app/export/fit_size.h"
#include "gs_app/export/importance.h"
#include "gs_core/config/text/markdown.h"
#include "gs_core/error.h"
#include "gs_core/geometry/world_offset.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// The model as the file is to hold it.
GaussianModel prepared(const GaussianModel& model, const ExportRequest& request) {
  GaussianModel result = copy_with_degree(model, request.sh_degree);
  transform_model(result, request.transform);
  return result;
}

/// Counts bytes and keeps none.
class CountingSink : public ByteSink {
 public:
  explicit CountingSink(std::string name) : name_(std::move(name)) {}
  std::string name() const override { return name_; }
  using ByteSink::write;
  void write(const void*, std::size_t count) override { bytes += count; }

  std::uint64_t bytes = 0;

 private:
  std::string name_;
};

/// What of the model fits into the request's size. The options are those that the file is written
/// with, so that it has the size that was found.
GaussianModel fitted(const GaussianModel& model, const ModelFormat& format,
                     const ExportRequest& request, const Viewpoints* viewpoints) {
  const std::string file = request.file.string();
  const auto size_of = [&](const GaussianModel& candidate) {
    CountingSink sink(file);
    write_model(sink, format, prepared(candidate, request), request.options);
    return sink.bytes;
  };
  return fit_size(model, request.most_bytes, size_of, viewpoints, file);
}

/// Compares the file with the original where that stands: in the frame of training.
Fidelity measure(const ExportedFile& exported, const ModelTransform& transform,
                 const Viewpoints& viewpoints) {
  GaussianModel kept = exported.format->read(exported.file);
  transform_model(kept, inverse_of(transform));
  return fidelity_of(kept, viewpoints);
}

/// The request's options, with what training views say of the Gaussians where the format asks.
ExportOptions options_for(const ModelFormat& format, const GaussianModel& model,
                          const ExportRequest& request, const Viewpoints* viewpoints) {
  ExportOptions options = request.options;
  if (!format.takes_importance || !viewpoints || !viewpoints->training || request.most_bytes > 0)
    return options;
  const std::vector<Camera> cameras = viewpoints->training();
  if (!cameras.empty()) options.importance = importance_of(*viewpoints, model.gaussians, cameras);
  return options;
}

void say_where(const ExportedFile& exported, const Vec3d& world_offset) {
  if (world_offset == Vec3d(0.0)) return;
  log_info(
      "{} lies near the origin, because floats cannot hold coordinates about {}; {} has the matrix "
      "back to the photos' coordinates",
      exported.file.string(), text_of_offset(world_offset),
      sidecar_of(exported.file).filename().string());
}

std::string size_text(std::uint64_t bytes) {
  return bytes < 100'000 ? fmt::format("{:.1f} kB", double(bytes) / 1e3)
                         : fmt::format("{:.1f} MB", double(bytes) / 1e6);
}

}  // namespace

void check_place(const fs::path& file, bool force, std::string_view how_to_force) {
  if (fs::symlink_status(file).type() == fs::file_type::not_found) return;
  if (!force)
    throw UsageError(
        fmt::format("{} is there already; choose another name, or {} to keep it as {}.bak-N",
                    file.string(), how_to_force, file.filename().string()));
  if (!fs::is_regular_file(file))
    throw UsageError(file.string() + " is not a file; choose another name");
}

void keep_older_aside(const fs::path& file) {
  if (fs::exists(file))
    log_info("the older {} is now {}", file.string(), keep_aside(file).string());
}

void check_export(const ExportRequest& request, bool force, std::string_view how_to_force) {
  format_to_write(request.file).require(request.options);
  for (const fs::path& file : {request.file, sidecar_of(request.file)})
    check_place(file, force, how_to_force);
}

bool is_lossy(const ExportRequest& request, int sh_degree) {
  const ModelFormat& format = format_to_write(request.file);
  return format.read &&
         (!format.is_lossless || request.sh_degree < sh_degree || request.most_bytes > 0);
}

ExportedFile export_model(const GaussianModel& whole, const ExportRequest& request,
                          const Viewpoints* viewpoints) {
  const ModelFormat& format = format_to_write(request.file);
  const OutputLock lock = OutputLock::of_file(request.file);
  std::optional<GaussianModel> smaller;
  if (request.most_bytes > 0) smaller = fitted(whole, format, request, viewpoints);
  const GaussianModel& model = smaller ? *smaller : whole;
  const fs::path sidecar = sidecar_of(request.file);
  keep_older_aside(request.file);
  keep_older_aside(sidecar);
  ExportedFile exported{request.file, &format, frames_of(format, model, request.transform),
                        std::min(request.sh_degree, model.sh_degree), model.antialiased};
  exported.was_moved = request.input_from_model.has_value();
  if (exported.was_moved) exported.frames.input_from_train = *request.input_from_model;
  exported.georeference = request.georeference;
  const bool is_changed = !request.transform.is_identity() || request.sh_degree < model.sh_degree;
  GaussianModel changed;
  if (is_changed) changed = prepared(model, request);
  const ExportOptions options = options_for(format, model, request, viewpoints);
  AtomicFile file(request.file);
  exported.gaussians = write_model(file, format, is_changed ? changed : model, options);
  // An older sidecar is never beside the newer file.
  file.commit(AtomicFile::Durability::synced, [&] { fs::remove(sidecar); });
  exported.bytes = fs::file_size(request.file);
  write_sidecar(exported);  // at once, as measuring may take minutes
  if (is_lossy(request, whole.sh_degree) && viewpoints && !viewpoints->cameras.empty()) {
    exported.fidelity = measure(exported, request.transform, *viewpoints);
    write_sidecar(exported);
  }
  if (!request.transform.turns_or_scales() && !exported.was_moved)
    say_where(exported, model.world_offset);
  return exported;
}

std::string summary(const ExportedFile& exported, const Viewpoints* viewpoints) {
  std::string text = fmt::format("{}: {}, {:.1f} bytes per Gaussian", exported.file.string(),
                                 size_text(exported.bytes), exported.bytes_per_gaussian());
  if (const auto& fidelity = exported.fidelity)
    text += fmt::format("; {:.2f} dB PSNR, {:.4f} SSIM against the model on {}", fidelity->psnr,
                        fidelity->ssim,
                        fmt::format(fmt::runtime(viewpoints->what), fidelity->num_views));
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
