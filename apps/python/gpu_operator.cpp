// SPDX-License-Identifier: Apache-2.0
// The operator of the GPU for gemsplat/_torch.py, which has checked its arrays. Arrays come as pointers
// to device memory, and so does the memory that a call needs.
#include <pybind11/functional.h>
#include <pybind11/stl.h>

#include "apps/python/module.h"
#include "data_loaders/cameras/camera_file.h"
#include "gs_app/run/make_backend.h"

namespace py = pybind11;

namespace gs::python {
namespace {

template <class T>
T* pointer(std::uintptr_t address) {
  return reinterpret_cast<T*>(address);
}

/// One view of some Gaussians, and how it is drawn.
struct Operation {
  OperatorInput input;
  RenderSettings settings;
  int device = 0;
};

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

/// Arrays by name: (address, numbers from row to row).
using Addresses = std::map<std::string, std::pair<std::uintptr_t, std::size_t>>;

Operation make_operation(const Addresses& arrays, std::size_t count, const py::dict& given) {
  Operation operation;
  OperatorInput& input = operation.input;
  RenderSettings& settings = operation.settings;
  input.count = count;
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
  input.has_inverse_depth = given["inverse_depth"].cast<bool>();
  input.room = given["max_instances"].cast<std::uint32_t>();
  if (given.contains("camera")) input.camera = given["camera"].cast<NamedCamera>().camera;
  input.camera.width = given["width"].cast<int>();
  input.camera.height = given["height"].cast<int>();
  operation.device = given["device"].cast<int>();
  settings.sh_degree = given["sh_degree"].cast<int>();
  settings.near_plane = given["near"].cast<float>();
  settings.far_plane = given["far"].cast<float>();
  settings.blur = given["blur"].cast<float>();
  settings.antialias = given["antialiased"].cast<bool>();
  settings.antialias_detach = false;
  settings.blend_rule = given["blend_rule"].cast<std::string>() == "classic" ? BlendRule::classic
                                                                             : BlendRule::faster_gs;
  settings.deterministic = given["deterministic"].cast<bool>();
  settings.for_backward = given["for_backward"].cast<bool>();
  settings.blends_depth = given["blends_depth"].cast<bool>();
  return operation;
}

/// A function of Python that returns the address of device memory.
AllocateOnDevice allocator(const py::function& allocate) {
  return [&allocate](std::size_t bytes) {
    const py::gil_scoped_acquire acquire;
    return pointer<void>(allocate(bytes).cast<std::uintptr_t>());
  };
}

std::unique_ptr<OperatorFrame> draw(const Operation& operation, std::uintptr_t stream,
                                    const py::function& kept, const py::function& scratch,
                                    std::uintptr_t image, std::uintptr_t alpha,
                                    std::uintptr_t depth, std::uintptr_t features) {
  const OperatorCall call{operation.device, pointer<void>(stream), allocator(kept),
                          allocator(scratch)};
  const py::gil_scoped_release release;
  return gpu_operator().draw(call, operation.input, operation.settings,
                             {pointer<float>(image), pointer<float>(alpha), pointer<float>(depth),
                              pointer<float>(features)});
}

void pull_back(const Operation& operation, const OperatorFrame& frame, std::uintptr_t stream,
               const py::function& scratch, std::uintptr_t image, std::uintptr_t alpha,
               std::uintptr_t depth, std::uintptr_t features, std::uintptr_t drawn_features,
               const Addresses& to) {
  OperatorGradients gradients;
  for (const auto& [name, at] : to) {
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
  RenderSettings settings = operation.settings;
  settings.absolute_gradient = gradients.absolute_screen != nullptr;
  const OperatorCall call{operation.device, pointer<void>(stream), nullptr, allocator(scratch)};
  const py::gil_scoped_release release;
  gpu_operator().pull_back(
      call, frame, operation.input, settings,
      {pointer<const float>(image), pointer<const float>(alpha), pointer<const float>(depth),
       pointer<const float>(features), pointer<const float>(drawn_features)},
      gradients);
}

/// Writes to the addresses of means2d, depths, conics, compensations and radii.
void find_footprints(const Operation& operation, std::uintptr_t stream, const std::string& shape,
                     float clip, int tile, const std::array<std::uintptr_t, 5>& to) {
  const OperatorCall call{operation.device, pointer<void>(stream), nullptr, nullptr};
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

void bind_gpu_operator(py::module_& module) {
  const auto address = [](const auto* at) { return reinterpret_cast<std::uintptr_t>(at); };
  module.def("gpu_compare", compare);
  py::class_<Operation>(module, "GpuOperation")
      .def(py::init(&make_operation))
      .def("draw", draw)
      .def("pull_back", pull_back)
      .def("footprints", find_footprints);
  py::class_<OperatorFrame>(module, "GpuFrame")
      .def_property_readonly("transmittance",
                             [=](const OperatorFrame& f) { return address(f.transmittance()); })
      .def_property_readonly("splats", [=](const OperatorFrame& f) { return address(f.splats()); })
      .def_property_readonly("tile_counts",
                             [=](const OperatorFrame& f) { return address(f.tile_counts()); })
      .def_property_readonly("overflowed",
                             [=](const OperatorFrame& f) { return address(f.overflowed()); });
}

}  // namespace gs::python
