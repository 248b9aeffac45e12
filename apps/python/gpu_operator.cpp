// SPDX-License-Identifier: Apache-2.0
// The operator of the GPU for gemsplat/_gpu.py, which has checked its arrays. Arrays come as pointers
// to device memory, and so does the memory that a call needs.
#include <pybind11/functional.h>
#include <pybind11/stl.h>

#include "apps/python/module.h"
#include "apps/python/operation.h"
#include "data_loaders/cameras/camera_file.h"
#include "gs_app/run/make_backend.h"

namespace py = pybind11;

namespace gs::python {
namespace {

template <class Number>
OperatorRows<Number>* rows_named(OperatorArrays<Number>& arrays, const std::string& name) {
  if (name == "means") return &arrays.means;
  if (name == "rotations") return &arrays.rotations;
  if (name == "scales" || name == "log_scales") return &arrays.scales;
  if (name == "covariances") return &arrays.covariances;
  if (name == "opacities" || name == "logit_opacities") return &arrays.opacities;
  if (name == "colors") return &arrays.colors;
  if (name == "sh0") return &arrays.sh0;
  if (name == "sh_rest") return &arrays.sh_rest;
  if (name == "screen") return &arrays.screen;
  return nullptr;
}

/// The address of a picture; null where there is none.
template <class T>
T* picture_named(const PictureAddresses& pictures, const char* name) {
  const auto found = pictures.find(name);
  return found == pictures.end() ? nullptr : pointer<T>(found->second);
}

/// A function of Python that returns the address of device memory.
AllocateOnDevice allocator(const py::function& allocate) {
  return [&allocate](std::size_t bytes) {
    const py::gil_scoped_acquire acquire;
    return pointer<void>(allocate(bytes).cast<std::uintptr_t>());
  };
}

Operation make_operation(const Addresses& arrays, const py::dict& given) {
  Operation operation(arrays, given);
  if (given.contains("camera")) operation.input.camera = given["camera"].cast<NamedCamera>().camera;
  return operation;
}

std::unique_ptr<OperatorFrame> draw(const Operation& operation, int device, std::uintptr_t stream,
                                    const py::function& kept, const py::function& scratch,
                                    const PictureAddresses& to) {
  const OperatorCall call{device, pointer<void>(stream), allocator(kept), allocator(scratch)};
  const py::gil_scoped_release release;
  return operation.draw(call, to);
}

void pull_back(const Operation& operation, const OperatorFrame& frame, int device,
               std::uintptr_t stream, const py::function& scratch,
               const PictureAddresses& by_pictures, const Addresses& by_arrays) {
  const OperatorCall call{device, pointer<void>(stream), nullptr, allocator(scratch)};
  const py::gil_scoped_release release;
  operation.pull_back(call, frame, by_pictures, by_arrays);
}

/// Writes to the addresses of means2d, depths, conics, compensations and radii.
void find_footprints(const Operation& operation, int device, std::uintptr_t stream,
                     const std::string& shape, float clip, int tile,
                     const std::array<std::uintptr_t, 5>& to) {
  const OperatorCall call{device, pointer<void>(stream), nullptr, nullptr};
  const py::gil_scoped_release release;
  gpu_operator().footprints(call, operation.input, operation.settings,
                            footprint_rule(shape, clip, tile),
                            {pointer<float>(to[0]), pointer<float>(to[1]), pointer<float>(to[2]),
                             pointer<float>(to[3]), pointer<int>(to[4])});
}

/// See OperatorComparison; sides is (planes, H, W), weights (l1, ssim).
void compare(int device, std::uintptr_t stream, const py::function& scratch, std::uintptr_t image,
             std::uintptr_t reference, const std::array<int, 3>& sides, int margin,
             const std::array<float, 2>& weights, std::uintptr_t value, std::uintptr_t dL_dimage) {
  const OperatorCall call{device, pointer<void>(stream), nullptr, allocator(scratch)};
  const py::gil_scoped_release release;
  gpu_operator().compare(call,
                         {pointer<const float>(image), pointer<const float>(reference), sides[0],
                          sides[1], sides[2], margin, weights[0], weights[1]},
                         pointer<float>(value), pointer<float>(dL_dimage));
}

}  // namespace

void Operation::set_arrays(const Addresses& arrays) {
  for (const auto& [name, at] : arrays) {
    const float* const address = pointer<const float>(at.first);
    if (name == "viewmats")
      input.viewmat = address;
    else if (name == "Ks")
      input.K = address;
    else if (name == "background")
      settings.background_on_device = address;
    else if (name == "features")
      input.features = address, input.channels = int(at.second);
    else if (name != "absolute_screen")
      *rows_named(input.arrays, name) = {address, at.second};
  }
  input.has_log_scales = arrays.contains("log_scales");
  input.has_logit_opacities = arrays.contains("logit_opacities");
}

std::unique_ptr<OperatorFrame> Operation::draw(const OperatorCall& call,
                                               const PictureAddresses& to) const {
  return gpu_operator().draw(
      call, input, settings,
      {picture_named<float>(to, "image"), picture_named<float>(to, "alpha"),
       picture_named<float>(to, "depth"), picture_named<float>(to, "features"),
       picture_named<float>(to, "rows"), picture_named<std::uint32_t>(to, "overflowed")});
}

void Operation::pull_back(const OperatorCall& call, const OperatorFrame& frame,
                          const PictureAddresses& by_pictures, const Addresses& by_arrays) const {
  OperatorGradients gradients;
  for (const auto& [name, at] : by_arrays) {
    float* const address = pointer<float>(at.first);
    if (name == "viewmats")
      gradients.viewmat = address;
    else if (name == "Ks")
      gradients.K = address;
    else if (name == "absolute_screen")
      gradients.absolute_screen = address;
    else if (name == "features")
      gradients.features = address;
    else
      *rows_named(gradients.arrays, name) = {address, at.second};
  }
  RenderSettings with_sums = settings;
  with_sums.absolute_gradient = gradients.absolute_screen != nullptr;
  gpu_operator().pull_back(call, frame, input, with_sums,
                           {picture_named<const float>(by_pictures, "image"),
                            picture_named<const float>(by_pictures, "alpha"),
                            picture_named<const float>(by_pictures, "depth"),
                            picture_named<const float>(by_pictures, "features"),
                            picture_named<const float>(by_pictures, "drawn_features")},
                           gradients);
}

void bind_gpu_operator(py::module_& module) {
  module.def("gpu_compare", compare);
  py::class_<Operation>(module, "GpuOperation")
      .def(py::init(&make_operation))
      .def("draw", draw)
      .def("pull_back", pull_back)
      .def("footprints", find_footprints);
  py::class_<OperatorFrame>(module, "GpuFrame")
      .def_property_readonly("transmittance", [](const OperatorFrame& frame) {
        return reinterpret_cast<std::uintptr_t>(frame.transmittance());
      });
  module.attr("GPU_ROW_NUMBERS") = kRowNumbers;
}

}  // namespace gs::python
