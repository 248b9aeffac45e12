// SPDX-License-Identifier: Apache-2.0
// What frameworks ask of the operator of the GPU, by names: arrays as pointers to device memory, and
// settings as gemsplat/_gpu.py writes them.
#pragma once

#include <pybind11/pybind11.h>

#include <map>
#include <string>
#include <utility>

#include "gs_core/system/text/json.h"
#include "gs_render/operator.h"

namespace gs::python {

template <class T>
T* pointer(std::uintptr_t address) {
  return reinterpret_cast<T*>(address);
}

/// Arrays by name: (address, numbers from row to row).
using Addresses = std::map<std::string, std::pair<std::uintptr_t, std::size_t>>;
/// Pictures by name.
using PictureAddresses = std::map<std::string, std::uintptr_t>;

/// One view of some Gaussians, and how it is drawn.
struct Operation {
  OperatorInput input;
  RenderSettings settings;

  /// Reads a dict of Python, or Json.
  template <class Given>
  Operation(const Addresses& arrays, const Given& given);

  /// Draws as SplatOperator does, on a GPU.
  std::unique_ptr<OperatorFrame> draw(const OperatorCall& call, const PictureAddresses& to) const;
  /// Pulls the gradients by pictures back to those by arrays. Beside features, "drawn_features" are
  /// those that were drawn.
  void pull_back(const OperatorCall& call, const OperatorFrame& frame,
                 const PictureAddresses& by_pictures, const Addresses& by_arrays) const;

 private:
  void set_arrays(const Addresses& arrays);
};

template <class T>
T setting(const pybind11::dict& given, const char* name) {
  return given[name].cast<T>();
}
template <class T>
T setting(const Json& given, const char* name) {
  return given.at(name).get<T>();
}

template <class Given>
Operation::Operation(const Addresses& arrays, const Given& given) {
  set_arrays(arrays);
  input.count = setting<std::size_t>(given, "count");
  input.has_inverse_depth = setting<bool>(given, "inverse_depth");
  input.room = setting<std::uint32_t>(given, "max_instances");
  input.camera.width = setting<int>(given, "width");
  input.camera.height = setting<int>(given, "height");
  settings.sh_degree = setting<int>(given, "sh_degree");
  settings.near_plane = setting<float>(given, "near");
  settings.far_plane = setting<float>(given, "far");
  settings.blur = setting<float>(given, "blur");
  settings.antialias = setting<bool>(given, "antialiased");
  settings.antialias_detach = false;
  settings.blend_rule = setting<std::string>(given, "blend_rule") == "classic"
                            ? BlendRule::classic
                            : BlendRule::faster_gs;
  settings.deterministic = setting<bool>(given, "deterministic");
  settings.for_backward = setting<bool>(given, "for_backward");
  settings.blends_depth = setting<bool>(given, "blends_depth");
}

}  // namespace gs::python
