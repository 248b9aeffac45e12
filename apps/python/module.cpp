// SPDX-License-Identifier: Apache-2.0
// The module gemsplat._gemsplat; gemsplat/__init__.py offers its names as gemsplat.
#include <pybind11/stl/filesystem.h>

#include "apps/python/devices.h"
#include "apps/python/module.h"
#include "gs_app/report/report_folder.h"
#include "gs_app/run/make_backend.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/version.h"
#include "gs_core/threads/parallel.h"
#include "gs_model/formats/formats.h"

namespace py = pybind11;

namespace gs::python {
namespace {

void set_verbosity(const std::string& name) {
  if (name != "quiet" && name != "normal" && name != "verbose")
    throw UsageError("there is no verbosity " + name + "; there are quiet, normal and verbose");
  setup_log(name == "quiet"    ? Verbosity::quiet
            : name == "normal" ? Verbosity::normal
                               : Verbosity::verbose);
}

}  // namespace
}  // namespace gs::python

PYBIND11_MODULE(_gemsplat, module) {
  using namespace gs;
  using namespace gs::python;
  module.attr("__version__") = kVersion;
  const py::object own_name = module.attr("__name__");
  module.attr("__name__") = "gemsplat";  // for the names of classes: gemsplat.Model
  bind_errors(module);
  bind_model(module);
  bind_camera(module);
  bind_scene(module);
  bind_render(module);
  bind_exact(module);
  bind_points(module);
  bind_gpu_operator(module);
  bind_jax(module);
  bind_progress(module);
  bind_train(module);
  bind_trainer(module);
  bind_edit(module);
  bind_jobs(module);
  module.attr("__name__") = own_name;
  module.def("set_verbosity", set_verbosity, py::arg("name"),
             "Sets how much is logged to standard error: quiet (warnings and errors, the default), "
             "normal or verbose.");
  module.def("set_threads", set_threads, py::arg("threads"),
             "Sets the number of threads for all work on the CPU; 0, the default: all cores. "
             "Throws UsageError while gemsplat trains or renders.");
  module.def("thread_count", thread_count, "The number of threads that work on the CPU.");
  module.def("cuda_device_count", cuda_device_count,
             "How many GPUs the device \"cuda:N\" can name; 0 also where gemsplat was built "
             "without CUDA.");
  module.def("write_report", write_folder_report, py::call_guard<py::gil_scoped_release>());
  setup_log(Verbosity::quiet);
}
