// SPDX-License-Identifier: Apache-2.0
// Between NumPy and our arrays: what comes in is checked and copied, what goes out is seen where it lies.
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

/// The argument as float32 in C order, converted where it is of another type of real numbers. Throws UsageError that names the
/// argument: for what is no array of numbers, for another shape, and for NaN or infinity.
FloatArray floats_of(const char* name, const py::handle& value, const Shape& shape);
/// The argument as uint8 in C order. Throws UsageError for any other type (0..1 or 0..255 is not guessed) or shape.
py::array_t<std::uint8_t, py::array::c_style> bytes_of(const char* name, const py::handle& value,
                                                       const Shape& shape);

/// Three numbers, finite. Throws UsageError.
Vec3d vector_of(const char* name, const py::handle& value);

/// Elements of one type that lie in memory of `owner`, which lives as long as the array. Strides in bytes; empty: in C order.
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

/// (height, width, channels), or (height, width) where there is one channel; takes the pixels over.
py::array_t<float> array_of(ImageF image);

}  // namespace gs::python
