// SPDX-License-Identifier: Apache-2.0
#include "apps/python/settings.h"

#include <pybind11/stl/filesystem.h>
#include <spdlog/fmt/fmt.h>

#include <string_view>

#include "gs_core/config/text/config_text.h"
#include "gs_core/error.h"

namespace py = pybind11;

namespace gs::python {
namespace {

bool is_path(const py::handle& value) {
  return py::isinstance<py::str>(value) || py::hasattr(value, "__fspath__");
}

bool is_list(const py::handle& value) {
  return py::isinstance<py::list>(value) || py::isinstance<py::tuple>(value);
}

// A value as TOML text.
std::string value_text(const std::string& key, const py::handle& value) {
  if (is_bool(value)) return PyObject_IsTrue(value.ptr()) ? "true" : "false";
  if (is_path(value)) return toml_text(value.cast<std::filesystem::path>().string());
  if (PyIndex_Check(value.ptr())) {
    if (PyObject* const whole = PyNumber_Index(value.ptr()))
      return py::str(py::reinterpret_steal<py::object>(whole));
    PyErr_Clear();  // an array, say
  }
  if (py::hasattr(value, "__float__")) return toml_text(value.cast<double>());
  if (is_list(value)) {
    std::string items;
    for (const py::handle& item : value)
      items += (items.empty() ? "" : ", ") + value_text(key, item);
    return "[" + items + "]";
  }
  throw UsageError(fmt::format("the setting {} cannot be a {}", key,
                               std::string(py::str(py::type::of(value).attr("__name__")))));
}

void merge_dict(Config& config, const py::dict& settings, const std::string& section) {
  for (const auto& [name, value] : settings) {
    if (!py::isinstance<py::str>(name)) throw UsageError("the names of settings must be text");
    const std::string key = section + std::string(py::str(name));
    if (py::isinstance<py::dict>(value))
      merge_dict(config, value.cast<py::dict>(), key + ".");
    else
      apply_setting(config, key + "=" + value_text(key, value));
  }
}

}  // namespace

bool is_bool(const py::handle& value) {
  return PyBool_Check(value.ptr()) ||
         std::string_view(Py_TYPE(value.ptr())->tp_name).starts_with("numpy.bool");
}

void merge_settings(Config& config, const py::handle& settings, const std::string& section) {
  if (settings.is_none()) return;
  if (py::isinstance<py::dict>(settings))
    merge_dict(config, settings.cast<py::dict>(), section);
  else if (is_path(settings))
    load_config(config, settings.cast<std::filesystem::path>());
  else if (is_list(settings))
    for (const py::handle& one : settings) merge_settings(config, one, section);
  else
    throw UsageError("config must be a dict, a name, or a list of these");
}

}  // namespace gs::python
