// SPDX-License-Identifier: Apache-2.0
// Between NumPy and our arrays. Arguments are checked and copied; results are views of our memory.
#pragma once

#include <pybind11/numpy.h>

#include <memory>
#include <string>
#include <vector>

#include "gs_core/image.h"
#include "gs_core/types.h"

namespace gs::python {

namespace py = pybind11;

using FloatArray = py::array_t<float, py::array::c_style | py::array::forcecast>;
using Shape = std::vector<py::ssize_t>;
inline constexpr py::ssize_t kAny = -1;  // in a shape that is asked for: any length

/// The argument as float32 in C order, converted from any other type of real numbers. Throws
/// UsageError that names the argument if it is no array of numbers, has another shape, or holds NaN
/// or infinity.
FloatArray floats_of(const char* name, const py::handle& value, const Shape& shape);
/// The argument as uint8 in C order. Throws UsageError for any other type, since 0..1 cannot be
/// told from 0..255, and for any other shape.
py::array_t<std::uint8_t, py::array::c_style> bytes_of(const char* name, const py::handle& value,
                                                       const Shape& shape);

/// Three numbers, finite. Throws UsageError.
Vec3d vector_of(const char* name, const py::handle& value);

/// An array over elements in the memory of `owner`, which lives as long as the array does. Strides
/// are in bytes; empty means C order.
template <class T>
py::array_t<T> array_in(const T* data, const Shape& shape, const Shape& strides,
                        const py::handle& owner, bool is_writable) {
  py::array_t<T> array = strides.empty() ? py::array_t<T>(shape, data, owner)
                                         : py::array_t<T>(shape, strides, data, owner);
  if (!is_writable) array.attr("setflags")(py::arg("write") = false);
  return array;
}

/// A capsule that keeps what the pointer owns.
template <class T>
py::capsule keep_alive(std::shared_ptr<T> owner) {
  return py::capsule(new std::shared_ptr<T>(std::move(owner)),
                     [](void* kept) { delete static_cast<std::shared_ptr<T>*>(kept); });
}

/// (height, width, channels), or (height, width) for one channel. The array takes over the pixels.
py::array_t<float> array_of(ImageF image);

}  // namespace gs::python
