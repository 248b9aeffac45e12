// SPDX-License-Identifier: Apache-2.0
#include "gs_app/session/export_run.h"

#include "gs_app/export/export_model.h"
#include "gs_core/log.h"

namespace gs {
namespace {

// The views that lossy formats are measured on.
Viewpoints viewpoints_of(Trainer& trainer) {
  Viewpoints viewpoints{
      trainer.backend(), trainer.model().gaussians.span(), trainer.evaluation_settings(), {}};
  const Scene& scene = trainer.scene();
  if (scene.test_views.empty()) viewpoints.what = "training";
  for (const View& view : scene.test_views.empty() ? scene.train_views : scene.test_views)
    viewpoints.cameras.push_back(view.camera);
  return viewpoints;
}

}  // namespace

void export_run(const std::vector<std::string>& formats, const RunFolder& folder,
                Trainer& trainer) {
  if (formats.empty()) return;
  const GaussianModel model = trained_model(trainer);
  const Viewpoints viewpoints = viewpoints_of(trainer);
  const std::filesystem::path ply = folder.ply(trainer.step());
  for (const std::string& name : formats) {
    ExportRequest request{ply, {}, {}};
    request.file.replace_extension(format_named(name).ending);
    if (request.file == ply) continue;  // it is written already
    log_info("{}", summary(export_model(model, request, &viewpoints), &viewpoints));
  }
}

}  // namespace gs
