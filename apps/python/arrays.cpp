// SPDX-License-Identifier: Apache-2.0
#include "apps/python/arrays.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <string_view>

#include "gs_core/error.h"

namespace gs::python {
namespace {

std::string text_of(const Shape& shape) {
  std::string text;
  for (const py::ssize_t length : shape)
    text += (text.empty() ? "" : ", ") + (length == kAny ? "N" : std::to_string(length));
  return "(" + text + (shape.size() == 1 ? ",)" : ")");
}

py::array any_array(const char* name, const py::handle& value) {
  const py::array array = py::array::ensure(value);
  if (array) return array;
  PyErr_Clear();
  throw UsageError(fmt::format("{} is not an array", name));
}

void check_shape(const char* name, const py::array& array, const Shape& wanted) {
  const Shape found(array.shape(), array.shape() + array.ndim());
  const bool fits = std::equal(found.begin(), found.end(), wanted.begin(), wanted.end(),
                               [](py::ssize_t length, py::ssize_t expected) {
                                 return expected == kAny || length == expected;
                               });
  if (!fits)
    throw UsageError(fmt::format("{} must have the shape {}, but has {}", name, text_of(wanted),
                                 text_of(found)));
}

void refuse_type(const char* name, const py::array& array, const char* wanted) {
  throw UsageError(fmt::format("{} must hold {}, but is of dtype {}", name, wanted,
                               std::string(py::str(array.dtype()))));
}

}  // namespace

FloatArray floats_of(const char* name, const py::handle& value, const Shape& shape) {
  const py::array array = any_array(name, value);
  if (std::string_view("fiu").find(array.dtype().kind()) == std::string_view::npos)
    refuse_type(name, array, "real numbers");
  check_shape(name, array, shape);
  const auto floats = FloatArray::ensure(array);
  if (!floats) throw UsageError(fmt::format("{} cannot be converted to float32", name));
  const float* const begin = floats.data();
  const float* const end = begin + floats.size();
  const float* const bad = std::find_if(begin, end, [](float x) { return !std::isfinite(x); });
  if (bad != end) {
    const py::ssize_t per_row =
        floats.ndim() ? floats.size() / std::max<py::ssize_t>(floats.shape(0), 1) : 1;
    throw UsageError(fmt::format("{} holds {} in row {}; every value must be a finite float32",
                                 name, *bad, (bad - begin) / std::max<py::ssize_t>(per_row, 1)));
  }
  return floats;
}

py::array_t<std::uint8_t, py::array::c_style> bytes_of(const char* name, const py::handle& value,
                                                       const Shape& shape) {
  const py::array array = any_array(name, value);
  if (!py::isinstance<py::array_t<std::uint8_t>>(array))
    refuse_type(name, array, "uint8, 0 to 255");
  check_shape(name, array, shape);
  return py::array_t<std::uint8_t, py::array::c_style>::ensure(array);
}

Vec3d vector_of(const char* name, const py::handle& value) {
  const auto numbers =
      py::array_t<double, py::array::c_style | py::array::forcecast>::ensure(value);
  if (!numbers) PyErr_Clear();
  if (!numbers || numbers.ndim() != 1 || numbers.size() != 3)
    throw UsageError(fmt::format("{} must be three numbers", name));
  const Vec3d vector{numbers.at(0), numbers.at(1), numbers.at(2)};
  for (int i = 0; i < 3; ++i)
    if (!std::isfinite(vector[i])) throw UsageError(fmt::format("{} must be finite", name));
  return vector;
}

py::array_t<float> array_of(ImageF image) {
  const auto kept = std::make_shared<ImageF>(std::move(image));
  Shape shape{kept->height, kept->width};
  if (kept->channels > 1) shape.push_back(kept->channels);
  return array_in<float>(kept->pixels.data(), shape, {}, keep_alive(kept), true);
}

}  // namespace gs::python
