// SPDX-License-Identifier: Apache-2.0
// Our arrays as NumPy's: views of our memory. gemsplat/_classes.py checks arrays that come in.
#pragma once

#include <pybind11/numpy.h>

#include <cstring>
#include <memory>
#include <tuple>
#include <vector>

#include "gs_core/buffer.h"
#include "gs_core/image.h"
#include "gs_core/types.h"

namespace gs::python {

namespace py = pybind11;

using FloatArray = py::array_t<float, py::array::c_style | py::array::forcecast>;
using ByteArray = py::array_t<std::uint8_t, py::array::c_style | py::array::forcecast>;
using Shape = std::vector<py::ssize_t>;

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
inline py::array_t<float> array_of(ImageF image) {
  const auto kept = std::make_shared<ImageF>(std::move(image));
  Shape shape{kept->height, kept->width};
  if (kept->channels > 1) shape.push_back(kept->channels);
  return array_in<float>(kept->pixels.data(), shape, {}, keep_alive(kept), true);
}

/// x, y, z as a tuple of Python.
template <class T>
std::tuple<double, double, double> three_of(const Vec3<T>& v) {
  return {v.x, v.y, v.z};
}

/// The elements of an array, which has as many, into a buffer.
template <class T>
void copy_rows(const FloatArray& from, const Buffer<T>& to) {
  if (from.size()) std::memcpy(to.data(), from.data(), std::size_t(from.size()) * sizeof(float));
}

}  // namespace gs::python
