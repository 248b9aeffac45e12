// SPDX-License-Identifier: Apache-2.0
#include "apps/python/module.h"
#include "gs_core/error.h"

namespace py = pybind11;

namespace gs::python {
namespace {

// Live as long as the interpreter.
py::object *g_error = nullptr, *g_usage_error = nullptr, *g_out_of_memory = nullptr;

py::object* make_class(py::module_& module, const char* name, const py::tuple& bases,
                       const char* meaning) {
  auto* const made = new py::exception<Error>(module, name, bases);
  made->attr("__doc__") = meaning;
  return made;
}

}  // namespace

void bind_errors(py::module_& module) {
  g_error = make_class(
      module, "Error", py::make_tuple(py::handle(PyExc_RuntimeError)),
      "A file, a device or a value that gemsplat cannot use; the text says what to try.");
  g_usage_error =
      make_class(module, "UsageError", py::make_tuple(*g_error, py::handle(PyExc_ValueError)),
                 "An argument or a setting that cannot be used.");
  g_out_of_memory = make_class(
      module, "OutOfMemoryError", py::make_tuple(*g_error, py::handle(PyExc_MemoryError)),
      "Memory of the host or a GPU ran out, and nothing else could be released.");
  py::register_exception_translator([](std::exception_ptr pointer) {
    try {
      if (pointer) std::rethrow_exception(pointer);
    } catch (const Error& error) {
      PyErr_SetString(error.code() == ExitCode::interrupted     ? PyExc_KeyboardInterrupt
                      : error.code() == ExitCode::usage         ? g_usage_error->ptr()
                      : error.code() == ExitCode::out_of_memory ? g_out_of_memory->ptr()
                                                                : g_error->ptr(),
                      error.what());
    }
  });
}

}  // namespace gs::python
