// SPDX-License-Identifier: Apache-2.0
#include "apps/python/errors.h"

#include <string>

#include "gs_core/error.h"

namespace py = pybind11;

namespace gs::python {
namespace {

// Live as long as the interpreter.
PyObject *g_error = nullptr, *g_usage_error = nullptr, *g_out_of_memory = nullptr;

PyObject* make_class(py::module_& module, const char* name, const char* meaning,
                     const py::tuple& bases) {
  const std::string full = std::string("gemsplat.") + name;
  PyObject* const made = PyErr_NewExceptionWithDoc(full.c_str(), meaning, bases.ptr(), nullptr);
  if (!made) throw py::error_already_set();
  module.add_object(name, py::handle(made));
  return made;
}

PyObject* class_of(ExitCode code) {
  return code == ExitCode::usage           ? g_usage_error
         : code == ExitCode::out_of_memory ? g_out_of_memory
                                           : g_error;
}

}  // namespace

void bind_errors(py::module_& module) {
  const auto bases = [](PyObject* first, PyObject* second) {
    return py::make_tuple(py::handle(first), py::handle(second));
  };
  g_error =
      make_class(module, "Error",
                 "A file, a device or a value that gemsplat cannot use; the text says what to try.",
                 py::make_tuple(py::handle(PyExc_RuntimeError)));
  g_usage_error = make_class(module, "UsageError", "An argument or a setting that cannot be used.",
                             bases(g_error, PyExc_ValueError));
  g_out_of_memory =
      make_class(module, "OutOfMemoryError",
                 "Memory of the host or a GPU ran out, and nothing else could be released.",
                 bases(g_error, PyExc_MemoryError));
  py::register_exception_translator([](std::exception_ptr pointer) {
    try {
      if (pointer) std::rethrow_exception(pointer);
    } catch (const Error& error) {
      PyErr_SetString(class_of(error.code()), error.what());
    }
  });
}

}  // namespace gs::python
