// SPDX-License-Identifier: Apache-2.0
#include "gs_app/session/export_run.h"

#include "gs_app/export/export_model.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

// The views that lossy formats are measured on.
Viewpoints viewpoints_of(Trainer& trainer) {
  Viewpoints viewpoints{
      trainer.backend(), trainer.model().gaussians.span(), trainer.evaluation_settings(), {}};
  const Scene& scene = trainer.scene();
  if (scene.test_views.empty()) viewpoints.what = "{} training views";
  for (const View& view : scene.test_views.empty() ? scene.train_views : scene.test_views)
    viewpoints.cameras.push_back(view.camera);
  viewpoints.training = [&scene] {
    std::vector<Camera> cameras;
    for (const View& view : scene.train_views) cameras.push_back(view.camera);
    return cameras;
  };
  return viewpoints;
}

std::filesystem::path export_file(const std::string& format, const RunFolder& folder, int step) {
  std::filesystem::path file = folder.ply(step);
  return file.replace_extension(format_named(format).ending);
}

// A sidecar gets the figures of a lossy format last, after minutes of rendering.
bool is_complete(const std::filesystem::path& file) {
  if (!std::filesystem::exists(file) || !std::filesystem::exists(sidecar_of(file))) return false;
  if (!is_lossy({.file = file}, kMaxShDegree)) return true;
  try {
    return read_json(sidecar_of(file)).contains("fidelity");
  } catch (const AccessError&) {
    throw;
  } catch (const Error&) {  // it is damaged
    return false;
  }
}

}  // namespace

std::vector<std::string> missing_exports(const std::vector<std::string>& formats,
                                         const RunFolder& folder) {
  std::vector<std::string> missing;
  const std::optional<int> step = folder.newest_step();
  if (!step) return missing;
  for (const std::string& format : formats) {
    const std::filesystem::path file = export_file(format, folder, *step);
    if (file != folder.ply(*step) && !is_complete(file)) missing.push_back(format);
  }
  return missing;
}

void export_run(const std::vector<std::string>& formats, const RunFolder& folder,
                Trainer& trainer) {
  if (formats.empty()) return;
  const GaussianModel model = trained_model(trainer);
  const Viewpoints viewpoints = viewpoints_of(trainer);
  const std::filesystem::path ply = folder.ply(trainer.step());
  for (const std::string& name : formats) {
    const ExportRequest request{export_file(name, folder, trainer.step()), {}, {}};
    if (request.file == ply) continue;  // it is written already
    log_info("{}", summary(export_model(model, request, &viewpoints), &viewpoints));
  }
}

}  // namespace gs
