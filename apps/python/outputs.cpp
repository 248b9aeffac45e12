// SPDX-License-Identifier: Apache-2.0
#include "apps/python/outputs.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <optional>
#include <string>
#include <vector>

#include "apps/python/camera.h"
#include "apps/python/devices.h"
#include "apps/python/model.h"
#include "gs_app/report/report_folder.h"
#include "gs_core/error.h"

namespace py = pybind11;

namespace gs::python {
namespace {

namespace fs = std::filesystem;

std::vector<Camera> cameras_of(const py::object& cameras) {
  std::vector<Camera> result;
  for (const NamedCamera& named : named_cameras_of(cameras)) result.push_back(named.camera);
  return result;
}

// Writes the file. Renders original and copy from the cameras, if there are any.
ExportedFile write(const Model& model, const ExportRequest& request,
                   const std::vector<Camera>& cameras, const std::string& device) {
  const Work work;
  if (cameras.empty()) return export_model(model.model, request, nullptr);
  const BorrowedBackend backend(device);
  const Gaussians there = copy_to(backend->memory(), model.model);
  const Viewpoints viewpoints{*backend, there.span(), view_settings(model, model.config), cameras};
  return export_model(model.model, request, &viewpoints);
}

py::dict export_file(const Model& model, const fs::path& path, const py::object& cameras,
                     const std::string& device, bool replace, int spz_version, int spz_sh_bits) {
  const std::vector<Camera> viewpoints = cameras_of(cameras);
  std::optional<ExportedFile> written;
  {
    const py::gil_scoped_release release;
    ExportRequest request = export_request(path, replace, spz_version, spz_sh_bits);
    request.input_from_model = model.input_from_model;
    written = write(model, request, viewpoints, device);
  }
  py::dict result(py::arg("file") = written->file,
                  py::arg("format") = std::string(written->format->name),
                  py::arg("gaussians") = written->gaussians, py::arg("bytes") = written->bytes,
                  py::arg("psnr") = py::none(), py::arg("ssim") = py::none());
  if (written->fidelity) {
    result["psnr"] = written->fidelity->psnr;
    result["ssim"] = written->fidelity->ssim;
  }
  return result;
}

fs::path report(const fs::path& folder, const std::optional<fs::path>& output) {
  const Work work;
  return write_folder_report(folder, output.value_or(folder / "report.html"));
}

}  // namespace

ExportRequest export_request(const fs::path& path, bool replace, int spz_version, int spz_sh_bits) {
  if (spz_version < 2 || spz_version > 4)
    throw UsageError("spz_version must be 2, 3 or 4, and is " + std::to_string(spz_version));
  if (spz_sh_bits < 0 || spz_sh_bits > 8)
    throw UsageError("spz_sh_bits must be 1 to 8, or 0 for the usual ones, and is " +
                     std::to_string(spz_sh_bits));
  const ExportRequest request{path, {spz_version, spz_sh_bits}, {}};
  check_export(request, replace, "give replace=True");
  return request;
}

void bind_outputs(py::module_& module) {
  module.def(
      "export", export_file, py::arg("model"), py::arg("path"), py::kw_only(),
      py::arg("cameras") = py::none(), py::arg("device") = "auto", py::arg("replace") = false,
      py::arg("spz_version") = 3, py::arg("spz_sh_bits") = 0,
      R"(Writes a model as `gemsplat export` does, in the format that the name ends in, and a file beside it,
NAME.transforms.json, with what the format cannot say (antialiased, world_offset). Model.save()
writes the same files and measures nothing.

Returns a dict: file, format, gaussians, bytes, psnr, ssim. The last two compare pictures of the
file with pictures of the model; they are None unless the format is lossy and cameras are given.
A file that is there already is refused (UsageError), or with replace=True kept as NAME.bak-N.)");
  module.def(
      "report", report, py::call_guard<py::gil_scoped_release>(), py::arg("folder"),
      py::arg("output") = py::none(),
      R"(Writes the report of a run's folder, finished or not, or of an experiment's output, as one HTML file
that opens in a browser. output: the file; FOLDER/report.html by default. Returns its path.)");
}

}  // namespace gs::python
